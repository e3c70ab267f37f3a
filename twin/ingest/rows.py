"""Positions of a drive's objects, by whichever method, → the records that the store keeps of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.adjustment import result
from geoloc.adjustment.result import Adjusted
from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.earth.geodesy import utm33_covariance_from_enu, utm33_from_geographic
from geoloc.earth.ground import MAX_RANGE_M
from geoloc.locate.combine import combine
from geoloc.reasons import Reason, sentence_of, sentences_of
from geoloc.trajectory.trajectory import Trajectory
from twin.drives.annotations.gather import epochs_of
from twin.drives.drive import Drive
from twin.ingest.locate import SightedObjects
from twin.store.drive_records import Sightings
from twin.store.kinds import Method
from twin.store.records import Boresight, Correction, Corrections, Covariance, Estimate, split_codes

_FAR_M = 15.0
_MANY_REJECTED = 0.25
"""Share of an object's sightings beyond which its track probably holds two signs."""


@dataclass(frozen=True, slots=True)
class Positions:
    """Where a drive's objects stand, one row each, in the order of `SightedObjects.name`.

    Attributes
    ----------
    latitude_deg, longitude_deg, height_m : float64 (g,)
        NaN where there is no position.
    sigma_height_m : float64 (g,)
        NaN where the method does not tell.
    covariance_m2 : float64 (g, 2, 2)
        East and true north.
    used : bool (n,)
    n_rejected : int64 (g,)
        Sightings that contradict the others.
    range_min_m : float64 (g,)
    by_source : mapping source → float64 (g, 2, 2)
        Where the covariance comes from; empty where the method does not tell.
    """

    latitude_deg: FloatArray
    longitude_deg: FloatArray
    height_m: FloatArray
    sigma_height_m: FloatArray
    covariance_m2: FloatArray
    used: BoolArray
    n_rejected: IntArray
    range_min_m: FloatArray
    by_source: Mapping[str, FloatArray]


def positions_of(sighted: SightedObjects) -> Positions:
    """Bring the sightings of each object together."""
    if sighted.adjusted is not None:
        return _adjusted(sighted, sighted.adjusted)
    combined = combine(sighted.located, sighted.group)
    return Positions(
        latitude_deg=combined.latitude_deg,
        longitude_deg=combined.longitude_deg,
        height_m=combined.height_m,
        sigma_height_m=np.full(sighted.name.size, np.nan),
        covariance_m2=combined.covariance_m2,
        used=combined.used,
        n_rejected=combined.n_rejected,
        range_min_m=combined.range_min_m,
        by_source={},
    )


def _adjusted(sighted: SightedObjects, adjusted: Adjusted) -> Positions:
    group, g = sighted.group, sighted.name.size
    nearest = np.full(g, np.inf)
    np.minimum.at(nearest, group[adjusted.used], adjusted.range_m[adjusted.used])
    return Positions(
        latitude_deg=adjusted.latitude_deg,
        longitude_deg=adjusted.longitude_deg,
        height_m=adjusted.height_m,
        sigma_height_m=adjusted.sigma_height_m,
        covariance_m2=adjusted.covariance_m2,
        used=adjusted.used,
        n_rejected=np.bincount(group[adjusted.rejected == Reason.OUTLIER], minlength=g),
        range_min_m=nearest,
        by_source=adjusted.by_source,
    )


def estimates_of(drive: Drive, sighted: SightedObjects, positions: Positions, method: str) -> list[Estimate]:
    """One estimate an object that has a position."""
    placed = np.isfinite(positions.latitude_deg)
    if not placed.any():
        return []
    place = positions.latitude_deg, positions.longitude_deg
    east, north = utm33_from_geographic(*place)
    covariance = utm33_covariance_from_enu(positions.covariance_m2, *place)
    order = np.argsort(sighted.group, kind="stable")
    members = np.split(order, np.cumsum(np.bincount(sighted.group, minlength=placed.size))[:-1])
    estimates = []
    for g in np.flatnonzero(placed).tolist():
        used = members[g][positions.used[members[g]]]
        estimates.append(
            Estimate(
                estimate_id=f"{drive.drive_id}:{sighted.name[g]}:{method}",
                drive_id=drive.drive_id,
                object=str(sighted.name[g]),
                method=Method(method),
                east_m=float(east[g]),
                north_m=float(north[g]),
                height_m=float(positions.height_m[g]),
                sigma_height_m=finite(positions.sigma_height_m[g]),
                covariance_m2=_triple(covariance[g]),
                range_min_m=float(positions.range_min_m[g]),
                n_rejected=int(positions.n_rejected[g]),
                flags=_flags(positions, sighted, g, used),
                budget={source: _triple(c[g]) for source, c in positions.by_source.items()},
                **_summary(drive, sighted, used),
            )
        )
    return estimates


def sightings_of(drive: Drive, sighted: SightedObjects, trajectory: Trajectory) -> Sightings:
    """Each sighting, with the position that it alone gives, and what the adjustment says of it.

    Then what was interpolated: in which picture the object was seen, and no more.
    """
    located, notes, index = sighted.located, drive.annotations, sighted.index
    east, north = utm33_from_geographic(located.latitude_deg, located.longitude_deg)
    covariance = utm33_covariance_from_enu(located.covariance_m2, located.latitude_deg, located.longitude_deg)
    numbers = {
        "east_m": east,
        "north_m": north,
        "cov_ee_m2": covariance[:, 0, 0],
        "cov_en_m2": covariance[:, 0, 1],
        "cov_nn_m2": covariance[:, 1, 1],
        "speed_mps": sighted.poses.speed_mps,
        **dict.fromkeys(_OF_ADJUSTMENT, np.full(index.size, np.nan)),
        "range_m": located.range_m,
    }
    if sighted.adjusted is not None:
        numbers |= _of_adjustment(sighted.adjusted, sighted.group)
    between = drive.interpolated
    n_between = len(between.frame)
    between_ns = epochs_of(between, drive.frame_epoch_ns) + drive.camera_offset_ns
    why = sentence_of(Reason.INTERPOLATED, max_range_m=MAX_RANGE_M, span_ns=(0, 0))
    pixel_px = np.concatenate([notes.pixel_px[index], between.pixel_px])
    box_px = np.concatenate([notes.box_px[index], between.box_px])
    return Sightings(
        object=np.concatenate([notes.object[index], between.object]),
        camera=np.concatenate([notes.camera[index], between.camera]),
        frame=np.concatenate([notes.frame[index], between.frame]),
        epoch_ns=np.concatenate([sighted.epoch_ns, between_ns]),
        kind=np.concatenate([notes.kind[index], between.kind]),
        u_px=pixel_px[:, 0],
        v_px=pixel_px[:, 1],
        width_px=box_px[:, 2] - box_px[:, 0],  # NaN for points
        height_px=box_px[:, 3] - box_px[:, 1],
        rejected=(*_why_rejected(sighted, trajectory), *[why] * n_between),
        is_measured=np.repeat([True, False], [index.size, n_between]),
        **{name: np.concatenate([values, np.full(n_between, np.nan)]) for name, values in numbers.items()},
    )


def _why_rejected(sighted: SightedObjects, trajectory: Trajectory) -> list[str]:
    """Why each sighting took no part, as people read it; "" where it did."""
    return sentences_of(
        sighted.reasons,
        max_range_m=MAX_RANGE_M,
        span_ns=trajectory.span_ns,
        seconds=trajectory.missing_s(sighted.epoch_ns),
    )


def corrections_of(adjusted: Adjusted | None, trajectory: Trajectory) -> Corrections | None:
    """What the adjustment found out about the car; None for other methods."""
    if adjusted is None:
        return None

    def kept(correction: result.Correction) -> Correction:
        return Correction(correction.value, finite(correction.sigma))

    return Corrections(
        pixel_noise_factor=adjusted.noise,
        camera_offset_ms=kept(adjusted.time_offset_ms),
        rolling_shutter_ms=kept(adjusted.readout_ms),
        boresight_deg={
            camera: Boresight(*map(kept, pitch_yaw_roll))
            for camera, pitch_yaw_roll in adjusted.boresight_deg.items()
        },
        camera_prior_ms=finite(adjusted.time_prior_ms),
        receiver_late_ms=1e3 * trajectory.late_sigma_s,
        camera_solved_ms=finite(adjusted.time_solved_ms),
        track_lasts_s=trajectory.lasts_s,
    )


def finite(value: float) -> float | None:
    """The number, or None for NaN and infinity, which neither JSON nor SQL has."""
    return float(value) if np.isfinite(value) else None


_OF_ADJUSTMENT = ("range_m", "residual_u_px", "residual_v_px", "eye_east_m", "eye_north_m")


def _of_adjustment(adjusted: Adjusted, group: IntArray) -> dict[str, FloatArray]:
    """Residuals, and the camera's place in the grid when it saw."""
    from geoloc.earth.geodesy import geographic_from_enu

    latitude, longitude = adjusted.latitude_deg[group], adjusted.longitude_deg[group]
    eye = geographic_from_enu(latitude, longitude, adjusted.eye_m[:, 0], adjusted.eye_m[:, 1])
    eye_east, eye_north = utm33_from_geographic(*eye)
    return {
        "range_m": adjusted.range_m,
        "residual_u_px": adjusted.residual_px[:, 0],
        "residual_v_px": adjusted.residual_px[:, 1],
        "eye_east_m": eye_east,
        "eye_north_m": eye_north,
    }


def _triple(covariance_m2: FloatArray) -> Covariance:
    """East-east, east-north and north-north of a matrix."""
    return float(covariance_m2[0, 0]), float(covariance_m2[0, 1]), float(covariance_m2[1, 1])


def _summary(drive: Drive, sighted: SightedObjects, member: IntArray) -> dict[str, Any]:
    """Label, code, text, type and counts of the sightings that one object's position comes from."""
    annotations, rows = drive.annotations, sighted.index[member]
    label, codes = _commonest(annotations.label[rows]), _commonest(annotations.skiltnummer[rows])
    texts = annotations.text[rows]
    cameras = sorted({str(camera) for camera in annotations.camera[rows]})
    return {
        "label": label,
        "codes": split_codes(codes),
        # One picture in which it could be read is enough.
        "text": _commonest(texts[texts != ""]) if (texts != "").any() else None,
        "nvdb_type": None if codes else drive.other_objects.get(label),
        "n_sightings": len(member),
        # Cameras that run side by side show the same instant in frames of their own.
        "n_frames": len({(annotations.camera[i], annotations.frame[i]) for i in rows}),
        "n_cameras": len(cameras),
        "cameras": tuple(cameras),
        "first_ns": int(sighted.epoch_ns[member].min()),
        "last_ns": int(sighted.epoch_ns[member].max()),
    }


def _commonest(values: NDArray[np.str_]) -> str:
    """The most frequent value; of equals the first in alphabetical order, so that runs agree."""
    unique, counts = np.unique(values, return_counts=True)
    return str(unique[np.argmax(counts)])


def _flags(positions: Positions, sighted: SightedObjects, g: int, used: IntArray) -> tuple[str, ...]:
    flags = []
    if used.size == 1:
        flags.append("one sighting")
    if positions.range_min_m[g] > _FAR_M:
        flags.append(f"never nearer than {_FAR_M:g} m")
    rejected = int(positions.n_rejected[g])
    if rejected:
        flags.append("1 outlier left out" if rejected == 1 else f"{rejected} outliers left out")
    if rejected >= 2 and rejected > _MANY_REJECTED * (used.size + rejected):
        flags.append("its track may hold two signs")
    if sighted.adjusted is not None and not (sighted.is_foot[used]).any():
        flags.append("its face, not its foot")
    return tuple(flags)
