"""What each sensor of a drive recorded: its span, rate, gaps and delay."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from geoloc.arrays import IntArray
from geoloc.trajectory.fix_checks import quality_counts
from geoloc.trajectory.poses import GnssFixes, PoseTrack
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.motion.read import MotionSeen

_NS_PER_S = 1_000_000_000
# A step this much longer than the usual one is a hole in the recording, and not one late sample.
_GAP_STEPS = 2.5
_MAX_GAPS = 100
"""Gaps that are listed; all are counted."""


class Gap(NamedTuple):
    """A hole in a recording, nanoseconds UTC."""

    first_ns: int
    last_ns: int

    @property
    def seconds(self) -> float:
        """How long it is."""
        return (self.last_ns - self.first_ns) / _NS_PER_S


@dataclass(frozen=True, slots=True)
class SensorSpan:
    """One sensor on the timeline.

    Attributes
    ----------
    name : str
        Antenna, ``poses``, what was measured of the car's motion, or camera.
    kind : {"GNSS", "poses", "motion", "frames", "annotations"}
    file : str
        Where it was read from.
    count : int
        Fixes, poses, frames with a stamp, or annotations.
    epoch_ns : int64 (n,)
        Rising; for cameras by the host's clock. Not part of the JSON document.
    rate_hz : float or None
        By the median step; None of fewer than three samples, and of annotations.
    gaps : tuple of Gap
        Steps longer than 2.5 usual ones, the first 100.
    n_gaps : int
    delay_ms, delay_spread_ms : float or None
        Median of host stamp minus epoch, and half the span that holds the middle 90 %.
    quality : dict of str to int
        Fix quality in words → number of fixes.
    headings, velocities : int or None
        Fixes with a heading, or velocity, of the receiver's own that is used; None for none.
    unit : str or None
        In which the car's motion was read.
    of_fixes, late_s : float or None
        The car's motion over what the fixes say, and how late its stamps are against them, seconds.
    """

    name: str
    kind: str
    file: str
    count: int
    epoch_ns: IntArray
    rate_hz: float | None = None
    gaps: tuple[Gap, ...] = ()
    n_gaps: int = 0
    delay_ms: float | None = None
    delay_spread_ms: float | None = None
    quality: dict[str, int] | None = None
    headings: int | None = None
    velocities: int | None = None
    unit: str | None = None
    of_fixes: float | None = None
    late_s: float | None = None

    def as_json(self) -> dict[str, Any]:
        """Give everything but the single epochs."""
        plain = (
            "name",
            "kind",
            "file",
            "count",
            "rate_hz",
            "n_gaps",
            "delay_ms",
            "delay_spread_ms",
            "quality",
            "headings",
            "velocities",
            "unit",
            "of_fixes",
            "late_s",
        )
        document: dict[str, Any] = {name: getattr(self, name) for name in plain}
        document |= {"first_ns": self.first_ns, "last_ns": self.last_ns}
        gaps = [{"first_ns": g.first_ns, "last_ns": g.last_ns, "seconds": g.seconds} for g in self.gaps]
        return document | {"gaps": gaps}

    @property
    def first_ns(self) -> int:
        """Epoch of the first sample."""
        return int(self.epoch_ns[0])

    @property
    def last_ns(self) -> int:
        """Epoch of the last sample."""
        return int(self.epoch_ns[-1])


def gnss_span(fixes: GnssFixes, file: str) -> SensorSpan:
    """Span of one antenna's fixes, by the epochs in the recording."""
    delay, spread = _delay_ms(fixes)
    quality = quality_counts(fixes.quality)
    span = _span(
        fixes.antenna, "GNSS", file, fixes.epoch_ns, delay_ms=delay, delay_spread_ms=spread, quality=quality
    )
    return replace(
        span,
        headings=int(np.isfinite(fixes.heading_deg).sum()) or None,
        velocities=int(np.isfinite(fixes.velocity_mps[:, 0]).sum()) or None,
    )


def poses_span(track: PoseTrack, file: str) -> SensorSpan:
    """Span of a full-pose track."""
    return _span("poses", "poses", file, track.epoch_ns)


def motion_span(seen: MotionSeen) -> SensorSpan:
    """Span of what the car measured of its own motion, by its stamps as UTC."""
    span = _span(str(seen.quantity), "motion", seen.file, seen.series.epoch_ns)
    return replace(span, unit=seen.unit, of_fixes=seen.check.ratio, late_s=seen.check.late_s)


def frames_span(camera: str, stamps_ns: IntArray, file: str) -> SensorSpan | None:
    """Span of a camera's frames; None if not one has a stamp."""
    known = stamps_ns[stamps_ns != NO_STAMP]
    return _span(camera, "frames", file, np.sort(known)) if len(known) else None


def annotations_span(camera: str, epoch_ns: IntArray, file: str) -> SensorSpan | None:
    """Span of a camera's annotations, one epoch each; None where none has a time."""
    known = np.sort(epoch_ns[epoch_ns != NO_STAMP])
    if not len(known):
        return None
    return SensorSpan(camera, "annotations", file, len(known), known)


def _span(
    name: str,
    kind: str,
    file: str,
    epoch_ns: IntArray,
    *,
    delay_ms: float | None = None,
    delay_spread_ms: float | None = None,
    quality: dict[str, int] | None = None,
) -> SensorSpan:
    step = np.diff(epoch_ns)
    usual = float(np.median(step)) if len(step) > 1 else 0.0
    wide = np.flatnonzero(step > _GAP_STEPS * usual) if usual else np.empty(0, np.int64)
    return SensorSpan(
        name=name,
        kind=kind,
        file=file,
        count=len(epoch_ns),
        epoch_ns=epoch_ns,
        rate_hz=_NS_PER_S / usual if usual else None,
        gaps=tuple(Gap(int(epoch_ns[i]), int(epoch_ns[i + 1])) for i in wide[:_MAX_GAPS]),
        n_gaps=len(wide),
        delay_ms=delay_ms,
        delay_spread_ms=delay_spread_ms,
        quality=quality,
    )


def _delay_ms(fixes: GnssFixes) -> tuple[float | None, float | None]:
    """Median delay of the host stamps and its spread; None where the host did not stamp."""
    late_ms = (fixes.host_ns - fixes.epoch_ns) / 1e6
    if not late_ms.any():
        return None, None
    low, middle, high = np.percentile(late_ms, [5, 50, 95])
    return float(middle), float(high - low) / 2.0
