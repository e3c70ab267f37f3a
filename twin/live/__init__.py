"""Positions while a drive goes on.

- :class:`LiveEngine`: fixes, frames and motion in, as they arrive → estimates with error ellipses
- :func:`arrivals_of`: a recorded drive as what arrived when; :func:`car_of`: the car that made it
- :func:`played`: the same in real time, or faster; :class:`Replay`: as a source
- :class:`LiveRun`: sources, engine and sinks, each in a thread of its own, until they end or are stopped
"""

from twin.live.engine import LiveCar, LiveEngine
from twin.live.estimates import Estimate, State
from twin.live.events import Arrival, Detection, Frame
from twin.live.replay import Replay, arrivals_of, car_of, played
from twin.live.run import LiveRun, RunSettings

__all__ = [
    "Arrival",
    "Detection",
    "Estimate",
    "Frame",
    "LiveCar",
    "LiveEngine",
    "LiveRun",
    "Replay",
    "RunSettings",
    "State",
    "arrivals_of",
    "car_of",
    "played",
]
