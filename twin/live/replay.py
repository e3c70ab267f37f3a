"""A recorded drive as what arrived when, and played in real time or faster."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from heapq import merge
from pathlib import Path
from threading import Event

import numpy as np

from geoloc.live.samples import Fix, Lag, MotionSample, Quantity
from geoloc.trajectory.trajectory import GnssFixes
from geoloc.trajectory.vehicle_motion import MotionSeries
from twin.drives.drive import Drive
from twin.drives.frames.stamp_files import NO_STAMP
from twin.errors import DriveError
from twin.ingest.budget import budget_of
from twin.ingest.locate import in_euref89
from twin.live.engine import LiveCar
from twin.live.events import Arrival, Detection, Frame


def car_of(drive: Drive) -> LiveCar:
    """Return the car that recorded a drive.

    Raises
    ------
    DriveError
        Of a drive without fixes: recorded poses are the work of others, after the drive.
    """
    if not drive.gnss:
        raise DriveError(
            f"{drive.path} has poses in place of GNSS fixes: twin live follows fixes; locate its signs with"
            " twin ingest-drive."
        )
    moved, (sigma_m, _) = in_euref89(drive)
    return LiveCar(
        rig=moved.rig,
        antennas=tuple(one.antenna for one in moved.gnss),
        budget=budget_of(moved, None, {}),
        lags={
            quantity: Lag(series.lag_s, series.lag_sigma_s) for quantity, series in _motion_of(moved).items()
        },
        wheelbase_m=None if moved.motion is None else moved.motion.wheelbase_m,
        readout_ms=moved.rolling_shutter_ms,
        pole_radius_m=moved.pole_radius_m,
        track_sigma_m=sigma_m,
    )


def arrivals_of(drive: Drive) -> Iterator[Arrival]:
    """Everything that a drive recorded, in the order in which it arrived.

    A fix arrives when the host stamped it, a frame when it was stamped, a sample of the car's motion when it
    was measured and its stated lag has passed. Frames of annotated cameras come with what was annotated in
    them, which may be nothing.
    """
    moved, _ = in_euref89(drive)
    streams = [
        *(_fixes(one) for one in moved.gnss),
        *(_samples(quantity, series) for quantity, series in _motion_of(moved).items()),
        *(_frames(moved, camera) for camera in sorted(set(moved.annotations.camera.tolist()))),
    ]
    return merge(*streams, key=lambda one: one.at_ns)


def played(
    arrivals: Iterable[Arrival],
    speed: float | None,
    *,
    clock_s: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[Arrival]:
    """Hand on what arrives at the pace at which it arrived.

    Parameters
    ----------
    arrivals : iterable of Arrival
    speed : float or None
        Times as fast; None: as fast as it goes.
    """
    began_s: float | None = None
    first_ns = 0
    for one in arrivals:
        if speed is not None:
            if began_s is None:
                began_s, first_ns = clock_s(), one.at_ns
            early_s = (one.at_ns - first_ns) / 1e9 / speed - (clock_s() - began_s)
            if early_s > 0.0:
                sleep(early_s)
        yield one


class Replay:
    """A recorded drive as a source.

    Parameters
    ----------
    drive : Drive
    speed : float or None
        Times as fast; None: as fast as it goes.
    """

    def __init__(self, drive: Drive, speed: float | None) -> None:
        self._drive, self._speed = drive, speed
        self._closed = Event()

    @property
    def name(self) -> str:
        """Return the name of its folder."""
        return Path(self._drive.path).name

    def arrivals(self) -> Iterator[Arrival]:
        """Yield what arrived, when it is time."""
        for one in played(arrivals_of(self._drive), self._speed, sleep=self._rest):
            if self._closed.is_set():
                return
            yield one

    def close(self) -> None:
        """End it."""
        self._closed.set()

    def _rest(self, for_s: float) -> None:
        self._closed.wait(for_s)


def _motion_of(drive: Drive) -> dict[Quantity, MotionSeries]:
    if drive.motion is None:
        return {}
    series = {one: getattr(drive.motion, one.value) for one in Quantity}
    return {quantity: one for quantity, one in series.items() if one is not None}


def _fixes(fixes: GnssFixes) -> Iterator[Arrival]:
    # Host stamps jitter: what was stamped later cannot have arrived before.
    arrived = np.maximum.accumulate(fixes.host_ns).tolist()
    for i, at_ns in enumerate(arrived):
        fix = Fix(
            antenna=fixes.antenna,
            epoch_ns=int(fixes.epoch_ns[i]),
            latitude_deg=float(fixes.latitude_deg[i]),
            longitude_deg=float(fixes.longitude_deg[i]),
            height_m=float(fixes.height_m[i]),
            quality=int(fixes.quality[i]),
            sigma_horizontal_m=float(fixes.sigma_horizontal_m[i]),
            sigma_vertical_m=float(fixes.sigma_vertical_m[i]),
            heading_deg=float(fixes.heading_deg[i]),
            heading_sigma_deg=float(fixes.heading_sigma_deg[i]),
            velocity_mps=tuple(fixes.velocity_mps[i].tolist()),
            velocity_sigma_mps=tuple(fixes.velocity_sigma_mps[i].tolist()),
        )
        yield Arrival(at_ns, fix)


def _samples(quantity: Quantity, series: MotionSeries) -> Iterator[Arrival]:
    late_ns = max(round(series.lag_s * 1e9), 0)
    rows = zip(series.epoch_ns.tolist(), series.values.tolist(), series.sigma.tolist(), strict=True)
    for epoch_ns, value, sigma in rows:
        yield Arrival(epoch_ns + late_ns, MotionSample(quantity, epoch_ns, value, sigma))


def _frames(drive: Drive, camera: str) -> Iterator[Arrival]:
    notes = drive.annotations
    rows = np.flatnonzero(notes.camera == camera)
    # A track's number says nothing of what other cameras see.
    known = notes.has_id & ~(notes.is_track & (np.unique(notes.camera).size > 1))
    of_frame: dict[int, list[Detection]] = {}
    box_px = notes.box_px[rows]
    columns = zip(
        notes.frame[rows].tolist(),
        notes.pixel_px[rows].tolist(),
        notes.kind[rows].tolist(),
        notes.object[rows].tolist(),
        known[rows].tolist(),
        notes.label[rows].tolist(),
        notes.skiltnummer[rows].tolist(),
        notes.text[rows].tolist(),
        (box_px[:, 3] - box_px[:, 1]).tolist(),
        strict=True,
    )
    for frame, (u, v), kind, name, has_id, label, code, text, size_px in columns:
        seen = Detection((u, v), kind, name if has_id else None, label, code, text, size_px)
        of_frame.setdefault(frame, []).append(seen)
    stamps = drive.frame_epoch_ns[camera]
    for number in np.flatnonzero(stamps != NO_STAMP).tolist():
        stamp = int(stamps[number])
        found = tuple(of_frame.get(number, ()))
        yield Arrival(stamp, Frame(camera, number, stamp + drive.camera_offset_ns, found))
