"""Where what is said of a drive goes.

- :class:`Lines`: a stream, usually standard output
- :class:`Pages`: pages in browsers, over WebSocket
"""

from twin.live.sinks.lines import Lines
from twin.live.sinks.pages import Pages

__all__ = ["Lines", "Pages"]
