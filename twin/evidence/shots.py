"""Which pictures show a finding best: near, sharp, and from different distances or cameras."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.locate.visibility import views
from geoloc.trajectory.poses import part
from twin.evidence.crops import GapKind
from twin.evidence.recordings import Lack, Recordings
from twin.evidence.sights import Marked, Sight, poses_at, sight_of
from twin.evidence.subjects import DriveOf, Seen, Subject
from twin.words.gaps import OtherCameras

MOST_VIEWS = 3
_MOST_FRAMES = 3
"""Frames that are decoded for a view, of which the sharpest is taken."""
_ALIKE = 1.15
"""Frames of one view are at most so much further away than its nearest one."""
_APART = 1.4
"""Views of one camera differ by at least this factor in distance."""
_RANGE_M = (4.0, 25.0)


@dataclass(frozen=True, slots=True)
class Look:
    """One picture in which a finding's sign is, or should be."""

    drive_id: str
    camera: str
    frame: int
    epoch_ns: int
    sight: Sight
    marked: Marked


@dataclass(frozen=True, slots=True)
class Shot:
    """One view of a finding: frames alike, the nearest first, of which one is to be taken."""

    change_id: str
    number: int
    codes: tuple[str, ...]
    looks: tuple[Look, ...]


def shots_of(
    subject: Subject,
    drives: Mapping[str, DriveOf],
    recordings: Mapping[str, Recordings],
    lacks: list[tuple[str, Lack]],
) -> list[Shot]:
    """Choose the views of one finding among the pictures that are there.

    Parameters
    ----------
    lacks : list of (drive_id, Lack)
        Gets why pictures of a drive could not be used.

    Returns
    -------
    list of Shot
        The best first, at most `MOST_VIEWS`; empty where no picture has the usual place of its face in it.
    """
    looks: list[Look] = []
    for drive_id in dict.fromkeys((*subject.seen, *subject.drive_ids)):
        if drive_id not in drives:
            continue
        drive, recording, seen = drives[drive_id], recordings[drive_id], subject.seen.get(drive_id)
        if recording.lack is not None:
            lacks.append((drive_id, recording.lack))
        elif seen is not None:
            if not any(recording.has(picture.camera, picture.frame) for picture in seen.pictures):
                lacks.append((drive_id, _other_cameras(seen, drive)))
            looks += _marked_looks(subject, seen, drive, recording)
        elif not subject.seen:
            looks += _unseen_looks(subject, drive, recording, lacks)
    # The whole window first, then what shows most of the sign.
    looks.sort(key=lambda look: (not look.sight.is_whole, -look.sight.px_per_m, look.drive_id, look.frame))
    return [
        Shot(subject.change_id, number, subject.codes, tuple(_alike(first, looks)))
        for number, first in enumerate(_different(looks))
    ]


def _marked_looks(subject: Subject, seen: Seen, drive: DriveOf, recording: Recordings) -> Iterator[Look]:
    """Pictures in which the sign was marked."""
    there = [picture for picture in seen.pictures if recording.has(picture.camera, picture.frame)]
    poses = poses_at(drive.poses, np.array([picture.epoch_ns for picture in there], dtype=np.int64))
    for k, picture in enumerate(there):
        sight = sight_of(
            drive.rig.camera(picture.camera),
            part(poses, slice(k, k + 1)),
            seen.place,
            is_face=seen.is_face,
            marked=picture.marked,
            nvdb=subject.nvdb,
            covariance_m2=subject.covariance_m2,
        )
        if sight is not None:
            yield Look(drive.drive_id, picture.camera, picture.frame, picture.epoch_ns, sight, picture.marked)


def _unseen_looks(
    subject: Subject, drive: DriveOf, recording: Recordings, lacks: list[tuple[str, Lack]]
) -> Iterator[Look]:
    """Pictures that had the place in view where NVDB has a sign that nobody saw."""
    lat, lon = geographic_from_utm33(subject.place.east_m, subject.place.north_m)
    cameras = [
        camera for camera in drive.cameras if camera in recording.pictures and camera in drive.rig.cameras
    ]
    near, far = _RANGE_M
    for camera in cameras:
        stamps = recording.stamps(camera)
        if isinstance(stamps, Lack):
            lacks.append((drive.drive_id, stamps))
            continue
        found = views(
            drive.rig,
            drive.poses,
            lat,
            lon,
            min_range_m=near,
            max_range_m=far,
            cameras=[camera],
            margin_px=0.0,
        )
        poses = np.concatenate([np.zeros(0, np.int64), *(one.pose for one in found)])
        for k in poses.tolist():
            epoch_ns = int(drive.poses.epoch_ns[k])
            frame = recording.frame_at(stamps, epoch_ns)
            sight = sight_of(
                drive.rig.camera(camera), part(drive.poses, slice(k, k + 1)), subject.place, nvdb=subject.nvdb
            )
            if frame is not None and sight is not None and recording.has(camera, frame):
                yield Look(drive.drive_id, camera, frame, epoch_ns, sight, Marked())


def _other_cameras(seen: Seen, drive: DriveOf) -> Lack:
    cameras = tuple(sorted({picture.camera for picture in seen.pictures}))
    return Lack(GapKind.NO_PICTURES, OtherCameras(drive.name, cameras))


def _different(looks: Sequence[Look]) -> list[Look]:
    chosen: list[Look] = []
    for look in looks:
        if len(chosen) < MOST_VIEWS and all(_differ(look, one) for one in chosen):
            chosen.append(look)
    return chosen


def _differ(a: Look, b: Look) -> bool:
    if (a.drive_id, a.camera) != (b.drive_id, b.camera):
        return True
    return abs(math.log(a.sight.range_m / b.sight.range_m)) >= math.log(_APART)


def _alike(first: Look, looks: Sequence[Look]) -> Iterator[Look]:
    """`first`, and frames of the same camera from about as far."""
    of_camera = [
        look
        for look in looks
        if (look.drive_id, look.camera) == (first.drive_id, first.camera)
        and 1.0 <= look.sight.range_m / first.sight.range_m <= _ALIKE
        and look.sight.is_whole == first.sight.is_whole
    ]
    frames = {look.frame: look for look in (first, *of_camera)}
    yield from list(frames.values())[:_MOST_FRAMES]
