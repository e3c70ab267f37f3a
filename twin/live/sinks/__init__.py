"""Where what is said of a drive goes: lines on a stream, an MQTT broker, pages in browsers."""

from twin.live.sinks.lines import Lines

__all__ = ["Lines"]
