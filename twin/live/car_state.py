"""The state of a car that drives: where it is, what delivers, what waits and what was lost on the way."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from geoloc.live.causal import Following
from twin.live.features import ellipse_of, grid_m, point, rounded, utc


class Health(StrEnum):
    """How what the car is fed with does."""

    WAITING = "waiting"
    """Nothing has come yet."""
    FINE = "fine"
    DEGRADED = "degraded"
    """Fixes of a worse kind than before, or of some of the antennas alone."""
    LOST = "lost"
    """Nothing comes any more."""


class Clock(StrEnum):
    """Whose time stepped."""

    HOST = "host"
    GNSS = "gnss"
    CAMERA = "camera"
    MOTION = "motion"


class ClockStep(NamedTuple):
    """A clock that stepped by so many seconds; what it stamps is taken by the time that it had before."""

    clock: Clock
    name: str
    """Of the antenna, the camera, the quantity; "" of the host."""
    step_s: float


class SinkState(NamedTuple):
    """One sink: whether it takes nothing at the moment, how many lines it did not get, whether it is gone."""

    name: str
    blocked: bool
    lost: int
    ended: bool


class SourceState(NamedTuple):
    """One source.

    Attributes
    ----------
    name : str
    lost : bool
        Whether it delivers nothing.
    ended : bool
        Whether it never will again.
    garbage : int
        Lines or messages of it so far that could not be read.
    dropped : int
        Pictures so far for which its detector was too slow.
    refused : tuple of str
        What it said of cameras that the car does not have, for people, each once.
    clock : int
        How often it has said that a time cannot be.
    spoilt : str
        Why the last of these could not, for people.
    why : str
        What else it said last, for people.
    """

    name: str
    lost: bool = False
    garbage: int = 0
    dropped: int = 0
    clock: int = 0
    spoilt: str = ""
    why: str = ""
    refused: tuple[str, ...] = ()
    ended: bool = False


class KeepState(NamedTuple):
    """The file of what is final: whether it cannot be written now; how much waits, and was given up."""

    name: str
    failing: bool
    waiting: int
    lost: int


class Where(NamedTuple):
    """Pose of the rig's origin; NaN where nothing can be said."""

    latitude_deg: float = math.nan
    longitude_deg: float = math.nan
    height_m: float = math.nan
    heading_deg: float = math.nan
    speed_mps: float = math.nan
    sigma_m: float = math.nan
    """One sigma a horizontal axis."""
    sigma_heading_deg: float = math.nan


class CarState(NamedTuple):
    """All of it at one time.

    Attributes
    ----------
    at_ns : int
        By the host's clock, UTC.
    where : Where
    position : Following
    gnss : Health
    cameras : tuple of (name, Health)
        Those that have delivered so far.
    queue : int
        What has arrived and waits for the engine.
    frames_dropped, others_dropped : int
        So far, as the engine did not follow: frames, and other arrivals.
    sources : tuple of SourceState
    sinks : tuple of SinkState
    keep : KeepState or None
    steps : int
        How often a clock stepped.
    last_step : ClockStep or None
    refused : int
        Frames of cameras that the car does not have, and detections without a pixel, so far.
    not_recorded : str
        Why nothing more is recorded, one sentence; "" while it is, or is not asked for.
    unchecked : str
        Why nothing more is held against the road database; "" while it is, or is not asked for.
    faults : int
        Arrivals at which twin itself failed; they were left out.
    """

    at_ns: int
    where: Where = Where()
    position: Following = Following.WAITING
    gnss: Health = Health.WAITING
    cameras: tuple[tuple[str, Health], ...] = ()
    queue: int = 0
    frames_dropped: int = 0
    others_dropped: int = 0
    sources: tuple[SourceState, ...] = ()
    sinks: tuple[SinkState, ...] = ()
    keep: KeepState | None = None
    steps: int = 0
    last_step: ClockStep | None = None
    refused: int = 0
    not_recorded: str = ""
    unchecked: str = ""
    faults: int = 0

    @property
    def id(self) -> str:
        """What it is about."""
        return "car"

    @property
    def lasts(self) -> bool:
        """Whether it is kept: the next one replaces it."""
        return False

    def feature(self) -> dict[str, Any]:
        """Return a GeoJSON feature at the car's place, or without one."""
        where = self.where
        known = math.isfinite(where.latitude_deg)
        return {
            "type": "Feature",
            "id": self.id,
            "geometry": point(where.longitude_deg, where.latitude_deg) if known else None,
            "properties": {
                "at": utc(self.at_ns),
                "position": self.position.value,
                "gnss": self.gnss.value,
                "cameras": {name: health.value for name, health in self.cameras},
                "queue": self.queue,
                "frames_dropped": self.frames_dropped,
                "others_dropped": self.others_dropped,
                "refused": self.refused,
                "sources": {
                    one.name: {"lost": one.lost, "garbage": one.garbage, "dropped": one.dropped}
                    for one in self.sources
                },
                "sinks": {
                    one.name: {"blocked": one.blocked, "lines_lost": one.lost, "ended": one.ended}
                    for one in self.sinks
                },
                "keep": None
                if self.keep is None
                else {"failing": self.keep.failing, "waiting": self.keep.waiting, "lost": self.keep.lost},
                "recording_failed": bool(self.not_recorded),
                "check_failed": bool(self.unchecked),
                "clock_steps": self.steps,
                "faults": self.faults,
                **(self._place() if known else {}),
            },
        }

    def _place(self) -> dict[str, float | None]:
        where = self.where
        easting, northing = grid_m(where.latitude_deg, where.longitude_deg)
        own = {
            "easting": easting,
            "northing": northing,
            "height_m": where.height_m,
            "heading_deg": where.heading_deg,
            "sigma_heading_deg": where.sigma_heading_deg,
            "speed_mps": where.speed_mps,
        }
        return {
            **{name: rounded(value) for name, value in own.items()},
            **ellipse_of(where.sigma_m**2 * np.eye(2)),
        }
