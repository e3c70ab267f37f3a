"""Mistakes that a drive can hold although every file reads well: places, headings, labels."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping

import numpy as np

from geoloc.arrays import IntArray
from geoloc.doubts import Doubt
from geoloc.earth.geodesy import inverse
from geoloc.trajectory.trajectory import GnssFixes, PoseTrack
from twin.drives.annotations.gather import epochs_of
from twin.drives.annotations.key_frames import CURE
from twin.drives.drive import Annotations, Drive
from twin.drives.epochs import clock_hint, stamps_hint, utc_text
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.notes import DriveDoubt, SkipKind, doubts
from twin.drives.track.read import Track
from twin.errors import DriveError

_NORWAY_LAT_DEG, _NORWAY_LON_DEG = (57.0, 81.5), (3.0, 35.0)
"""Mainland and Svalbard, with a margin."""
_MOVING_MPS = 2.0
_HEADING_WARN_DEG, _HEADING_REFUSE_DEG = 10.0, 30.0
_NS_PER_S = 1e9
_ENOUGH_KEY_FRAMES = 3
_LOST = (SkipKind.UNUSABLE, SkipKind.NO_TIME, SkipKind.DAMAGED_FILE)
_MOST_REASONS = 3
_ANOTHER_DRIVE_S = 3600.0
"""A receiver that died is not back an hour later on the same drive."""


def check_track(drive: Drive) -> tuple[Doubt, ...]:
    """Refuse a track that cannot be right, and warn of one that hardly is.

    Returns
    -------
    tuple of Doubt

    Raises
    ------
    DriveError
        The track is not in Norway, the antennas' recordings are of different drives, or the headings of a
        pose file do not follow the track.
    """
    tracks: list[tuple[str, GnssFixes | PoseTrack]] = [(fixes.antenna, fixes) for fixes in drive.gnss]
    if drive.poses is not None:
        tracks.append(("the pose file", drive.poses))
    for name, track in tracks:
        _check_place(drive.name, name, track)
    _check_days(drive)
    return doubts(DriveDoubt.TRACK, *_check_headings(drive)) if drive.poses is not None else ()


def _check_place(drive: str, name: str, track: GnssFixes | PoseTrack) -> None:
    lat, lon = float(np.median(track.latitude_deg)), float(np.median(track.longitude_deg))
    if _in_norway(lat, lon):
        return
    swapped = "latitude and longitude are swapped" if _in_norway(lon, lat) else "check the coordinates"
    raise DriveError(
        f"The positions of {name} in {drive} (about {lat:.4f}° N, {lon:.4f}° E) are not in Norway: {swapped}."
    )


def _in_norway(lat: float, lon: float) -> bool:
    return bool(
        _NORWAY_LAT_DEG[0] <= lat <= _NORWAY_LAT_DEG[1] and _NORWAY_LON_DEG[0] <= lon <= _NORWAY_LON_DEG[1]
    )


def _check_days(drive: Drive) -> None:
    """Refuse antennas that were recorded hours apart: one recording is that of another drive."""
    recorded = sorted(drive.gnss, key=lambda fixes: int(fixes.epoch_ns[0]))
    for before, after in itertools.pairwise(recorded):
        apart_s = int(after.epoch_ns[0] - before.epoch_ns[-1]) / _NS_PER_S
        if apart_s > _ANOTHER_DRIVE_S:
            raise DriveError(
                f"The recording of {after.antenna} in {drive.name} begins {apart_s / 3600:.1f} h after that"
                f" of {before.antenna} ends ({utc_text(int(after.epoch_ns[0]))} and"
                f" {utc_text(int(before.epoch_ns[-1]))}): bring the recordings of one drive together."
            )


def _check_headings(drive: Drive) -> tuple[str, ...]:
    """Compare headings with the direction of travel; a car that reverses is 180° off, and allowed."""
    track = drive.poses
    if track is None or len(track.epoch_ns) < 3:
        return ()
    # Over steps of a second or so: neighbouring poses may lie millimetres apart.
    step = max(1, round(len(track.epoch_ns) / max(np.ptp(track.epoch_ns) / _NS_PER_S, 1.0)))
    here, there = slice(None, -step), slice(step, None)
    course, distance = inverse(
        track.latitude_deg[here],
        track.longitude_deg[here],
        track.latitude_deg[there],
        track.longitude_deg[there],
    )
    seconds = (track.epoch_ns[there] - track.epoch_ns[here]) / _NS_PER_S
    moving = distance > _MOVING_MPS * seconds
    if not moving.any():
        return ()
    heading = track.heading_deg[here][moving]
    off = np.abs((heading - course[moving] + 180.0) % 360.0 - 180.0)
    median = float(np.median(np.minimum(off, 180.0 - off)))
    text = (
        f"The headings of the pose file in {drive.name} differ from the direction of travel by {median:.0f}° "
        "(median): heading_deg must be degrees, clockwise from true north"
    )
    if median > _HEADING_REFUSE_DEG:
        raise DriveError(f"{text}.")
    return (f"{text}.",) if median > _HEADING_WARN_DEG else ()


def mostly_left_out(drive: Drive) -> str:
    """Say that more than half of a drive's annotations were left out while it was read; "" if they were not.

    Repeats, slips and other people's versions of a task are not lost; shapes that stand for no sign are only
    where there is nothing else. A damaged file counts as one annotation.
    """
    kept = len(drive.annotations.frame) + len(drive.interpolated.frame)
    kinds = _LOST if kept else (*_LOST, SkipKind.OTHER_SHAPE)
    lost = sorted((s for s in drive.skipped if s.kind in kinds), key=lambda s: -s.count)
    n_lost = sum(s.count for s in lost)
    if n_lost <= kept:
        return ""
    told = "; ".join(f"{s.count:,} of {s.where}: {s.reason}" for s in lost[:_MOST_REASONS])
    more = f"; and {len(lost) - _MOST_REASONS} more reasons" if len(lost) > _MOST_REASONS else ""
    return (
        f"More than half of the annotations of {drive.name} cannot be used, {n_lost:,} of {n_lost + kept:,}"
        f" ({told}{more})"
    )


def check_enough_read(drive: Drive) -> None:
    """Refuse a drive of whose annotations more than half were left out.

    Raises
    ------
    DriveError
    """
    said = mostly_left_out(drive)
    if said:
        raise DriveError(
            f"{said}: correct them, or let the others count alone with twin ingest-drive --partial."
        )


def annotation_warnings(drive: Drive, n_located: int, placed: Collection[str]) -> tuple[Doubt, ...]:
    """Warn of annotations that give less than their annotator thinks.

    Parameters
    ----------
    n_located : int
        Annotations that got a position.
    placed : collection of str
        Objects that got one.
    """
    annotations = drive.annotations
    warnings = []
    objects, counts = np.unique(annotations.object, return_counts=True)
    is_sign = drive.is_sign()
    n_without_code = len(np.unique(annotations.object[is_sign & (annotations.skiltnummer == "")]))
    if not is_sign.all():
        types = sorted({drive.other_objects[label] for label in annotations.label[~is_sign].tolist()})
        warnings.append(
            f"{len(np.unique(annotations.object[~is_sign]))} of {len(objects)} annotated objects are no signs"
            f" (NVDB types {', '.join(map(str, types))}): they are located and exported, not compared with"
            " NVDB."
        )
    if n_without_code:
        warnings.append(
            f"{n_without_code} of {len(objects)} annotated objects have no sign code, so their type cannot "
            "be compared: give the attribute skiltnummer (362.50), or a label that begins with a code."
        )
    warnings += _few_key_frames(drive, dict(zip(objects.tolist(), counts.tolist(), strict=True)), placed)
    once = int((counts == 1).sum())
    if len(objects) >= 10 and once > 0.5 * len(objects):
        warnings.append(
            f"{once} of {len(objects)} annotated objects were seen once only: if these are the "
            "same poles in several pictures, give them the attribute object, or annotate tracks."
        )
    dropped = sum(s.count for s in drive.skipped if s.is_annotation)
    n_all = len(annotations.frame) + dropped
    if n_all and n_located < 0.5 * n_all:
        warnings.append(
            f"Only {n_located:,} of {n_all:,} annotations could be located: see what was left out, and why."
        )
    return doubts(DriveDoubt.ANNOTATIONS, *warnings)


def _few_key_frames(drive: Drive, counts: Mapping[str, int], placed: Collection[str]) -> list[str]:
    """Tell of tracks whose key frames are too few to place them."""
    tracks = set(drive.interpolated.object.tolist()) - set(placed)
    few = sorted(name for name in tracks if 0 < counts.get(name, 0) < _ENOUGH_KEY_FRAMES)
    if not few:
        return []
    sentence = (
        f"Annotated objects without a position for want of key frames: {len(few):,} (such as {few[0]:.60}),"
        f" each with one or two, as what was interpolated is not measured: {CURE}."
    )
    return [sentence]


Span = tuple[int, int]


def check_span(
    annotations: Annotations,
    stamps: Mapping[str, IntArray],
    sources: Mapping[str, str],
    offset_ns: int,
    track: Track,
) -> list[str]:
    """Refuse a drive whose annotated frames all lie outside the track; tell of cameras where some do.

    Parameters
    ----------
    annotations : Annotations
        Each with a time.
    stamps, sources : mapping of camera to int64 (frames,), and to the file that says so
    offset_ns : int
        Added to the stamps.
    track : Track

    Raises
    ------
    DriveError
    """
    cameras = np.unique(annotations.camera).tolist()
    if not cameras:
        return []
    epoch_ns = epochs_of(annotations, stamps) + offset_ns
    epochs = {camera: epoch_ns[annotations.camera == camera] for camera in cameras}
    span = track.span_ns()
    outside = {camera: _outside(epochs[camera], span) for camera in cameras}
    what = "poses" if track.poses is not None else "GNSS fixes"
    if all(outside[c] == len(epochs[c]) for c in cameras):
        hint = clock_hint(_span(epoch_ns), span)
        raise DriveError(
            f"Every annotated frame lies outside the {what}: the frames are {_spans(epoch_ns, span, what)}."
            f" Bring files of one drive together, or correct the clocks with camera_offset_ms in"
            f" {SETTINGS_FILE}. {hint}".rstrip()
        )
    if len(cameras) > 1 and any(outside[c] == len(epochs[c]) for c in cameras):
        # Of one clock all cameras would be off.
        return [
            f"All {n} annotations of {c} lie outside the {what} and cannot be located: its frames are"
            f" {_spans(epochs[c], span, what)}. {stamps_hint(_span(epochs[c]), span, sources[c])}".rstrip()
            for c, n in outside.items()
            if n == len(epochs[c])
        ]
    if not any(outside.values()):
        return []
    n_outside = sum(outside.values())
    said = (
        f"{n_outside} of {len(epoch_ns)} annotations lie outside the {what} and cannot be located: the"
        f" annotated frames are {_spans(epoch_ns, span, what)}. {clock_hint(_span(epoch_ns), span)}"
    )
    return [said.rstrip()]


def _outside(epoch_ns: IntArray, span: Span) -> int:
    return int(np.count_nonzero((epoch_ns < span[0]) | (epoch_ns > span[1])))


def _span(epoch_ns: IntArray) -> Span:
    return int(epoch_ns.min()), int(epoch_ns.max())


def _spans(epoch_ns: IntArray, track: Span, what: str) -> str:
    (first, last), (begin, end) = map(utc_text, _span(epoch_ns)), map(utc_text, track)
    return f"from {first} to {last}, the {what} from {begin} to {end}"
