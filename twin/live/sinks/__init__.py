"""Where what is said of a drive goes.

- :class:`Lines`: a stream, usually standard output
- :class:`Mqtt`: a topic at an MQTT broker
- :class:`Pages`: pages in browsers, over WebSocket
"""

from twin.live.sinks.lines import Lines
from twin.live.sinks.mqtt import Mqtt
from twin.live.sinks.pages import Pages

__all__ = ["Lines", "Mqtt", "Pages"]
