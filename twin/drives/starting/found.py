"""What a folder from a small camera holds, as far as its first ``drive.toml`` needs it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from geoloc.calibration_files import CALIBRATION_KINDS
from geoloc.rig.rig import Rig
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import Progress, ReadingNotes
from twin.drives.folder.sensor_names import plain
from twin.drives.frames.video import VideoIndex, decoded, index_video, video_tags
from twin.drives.inspection.recognise import FileSeen, recognised
from twin.drives.starting.clock import VideoStart, start_of
from twin.drives.track.find import find_gnss, find_poses
from twin.drives.track.formats.gpmf import is_gopro_video, start_by_gps
from twin.drives.track.formats.recording import Recording
from twin.drives.track.read import read_track
from twin.errors import DriveError, RefusedError

if TYPE_CHECKING:
    from collections.abc import Mapping

_NO_RIG = Rig({}, {}, "the folder")
_CALIBRATIONS = {f"calibration, {name}" for name in CALIBRATION_KINDS.values()}
_NAMES_OF_LENSES = (
    ("iphone", "iphone main"),
    ("pixel", "pixel main"),
    # GoPro's firmware is called HD5 to HD8 in HERO5 to 8.
    *((f"hd{number}.", "gopro hero5-8 wide") for number in range(5, 9)),
    ("gopro", "gopro hero9-12 wide"),
    ("insta360", "insta360 one r 1-inch"),
    ("osmo", "dji osmo action"),
    ("dji", "dji osmo action"),
    ("blackvue", "blackvue 139"),
    ("viofo", "viofo a129"),
    ("nextbase", "nextbase 322-622"),
    ("garmin", "garmin dash cam 140"),
)
"""Words in a video's tags, the first that is there, and the lens that they speak of."""


@dataclass(frozen=True, slots=True)
class Found:
    """One camera's recording.

    Attributes
    ----------
    camera : str
        Called after the video.
    video : str
    size_px : (int, int)
        Of its pictures as they are shown.
    start : VideoStart or None
        When it began; None where nothing says that.
    start_sigma_s : float
        How well that is known.
    track : str or None
        The GNSS recording or pose file; None where there is none.
    is_poses : bool
        Whether the track is full poses.
    lens : str or None
        Of the table of common cameras, by the video's tags.
    calibrations, annotations : tuple of str
        Files of these kinds.
    """

    camera: str
    video: str
    size_px: tuple[int, int]
    start: VideoStart | None
    start_sigma_s: float
    track: str | None
    is_poses: bool
    lens: str | None
    calibrations: tuple[str, ...]
    annotations: tuple[str, ...]


def look(
    path: Path | str,
    *,
    video: str | None = None,
    gnss: str | None = None,
    progress: Progress | None = None,
) -> Found:
    """Look at a folder with one video and where the car was.

    Parameters
    ----------
    path : Path or str
    video, gnss : str, optional
        Which of several.
    progress : callable, optional
        Called with one sentence a step.

    Raises
    ------
    DriveError
        There is no video, or several and none is named, or they cannot be read.
    RefusedError
        The folder describes itself: it has a rig file.
    """
    folder, notes = DriveFolder(Path(path)), ReadingNotes(progress)
    notes.say("looking at every file")
    files = recognised(folder)
    rigs = _of_kinds(files, {"DriveWorks rig"})
    if rigs:
        raise RefusedError(
            f"{path} has the rig file {rigs[0]}, which describes its cameras: twin inspect {path} says what"
            " is missing."
        )
    name = _one(folder, _of_kinds(files, {"video"}), video)
    notes.say(f"reading {name}")
    with folder.open(name) as file:
        index = index_video(file, name)
    track, is_poses = _track(folder, name, gnss)
    span = None if track is None else _span_ns(folder, track, is_poses=is_poses)
    start, sigma_s = start_of(index, span), 1.0
    by_gps = start_by_gps(Recording(folder, track)) if track == name else None
    if by_gps is not None:
        start, sigma_s = VideoStart(by_gps.epoch_ns, by_gps.why, fits=True), by_gps.sigma_s
    return Found(
        camera=plain(PurePosixPath(name).stem) or "camera",
        video=name,
        size_px=_shown_size(folder, index),
        start=start,
        start_sigma_s=sigma_s,
        track=track,
        is_poses=is_poses,
        lens=_lens(folder, name, is_gopro=track == name),
        calibrations=tuple(_of_kinds(files, _CALIBRATIONS)),
        annotations=tuple(file.name for file in files if file.kind.startswith("annotations, ")),
    )


def _of_kinds(files: Sequence[FileSeen], kinds: set[str]) -> list[str]:
    return [file.name for file in files if file.kind in kinds]


def _one(folder: DriveFolder, videos: Sequence[str], asked: str | None) -> str:
    """The only video, or the one that is asked for."""
    if asked is not None:
        folder.open(asked).close()  # which says where it is not
        return asked
    if len(videos) == 1:
        return videos[0]
    if not videos:
        raise DriveError(
            f"{folder.root} holds no video (.mp4, .mov, .mkv, .avi, .ts): copy the recording into the folder."
            f" Pictures are named under [frames] in {SETTINGS_FILE} (twin help frames)."
        )
    raise DriveError(
        f"{folder.root} holds {len(videos)} videos ({', '.join(videos)[:300]}), and a drive of one camera has"
        f" one: say which with --video {videos[0]}, or join the parts of one recording first (ffmpeg -f"
        " concat)."
    )


def _track(folder: DriveFolder, video: str, asked: str | None) -> tuple[str | None, bool]:
    """Where the car was: the file asked for, the only recording, the video itself, or full poses."""
    if asked is not None:
        return asked, False
    files, _ = find_gnss(folder, _NO_RIG)
    if len(files) > 1:
        names = sorted(files.values())
        raise DriveError(
            f"{folder.root} holds {len(names)} GNSS recordings ({', '.join(names)[:300]}): say which with"
            f" --gnss {names[0]}."
        )
    if files:
        return next(iter(files.values())), False
    if is_gopro_video(Recording(folder, video)):
        return video, False
    poses = find_poses(folder)
    return poses, poses is not None


def _span_ns(folder: DriveFolder, track: str, *, is_poses: bool) -> tuple[int, int]:
    settings = DriveSettings(poses=track) if is_poses else DriveSettings(gnss={"receiver": track})
    return read_track(folder, settings, _NO_RIG, ReadingNotes(None)).span_ns()


def _shown_size(folder: DriveFolder, index: VideoIndex) -> tuple[int, int]:
    """Width and height of the first picture, turned as it is shown."""
    from collections import Counter

    wanted = np.zeros(index.n_frames, dtype=np.bool_)
    wanted[0] = True
    with folder.open(index.where) as file:
        for _, image in decoded(file, index, wanted, Counter()):
            return image.shape[1], image.shape[0]
    return index.width_px, index.height_px


def _lens(folder: DriveFolder, video: str, *, is_gopro: bool) -> str | None:
    with folder.open(video) as file:
        tags: Mapping[str, str] = video_tags(file, video)
    said = " ".join((video, *tags.values())).casefold()
    found = next((lens for word, lens in _NAMES_OF_LENSES if word in said), None)
    return found or ("gopro hero9-12 wide" if is_gopro else None)
