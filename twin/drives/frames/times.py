"""When each picture was taken: by a file of stamps, or by what the pictures say themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import IntArray
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.folder.notes import Skipped
from twin.drives.frames.clocks import STATED_MS, WHOLE_SECONDS_MS, StatedClock, computed, stated_start
from twin.drives.frames.find import Pictures
from twin.drives.frames.images import HEAD_BYTES, exif_epoch, exif_needs_zone
from twin.drives.frames.name_times import epoch_from_name, needs_zone
from twin.drives.frames.pairing import pair
from twin.drives.frames.stamp_files import (
    NO_STAMP,
    increasing,
    names_images,
    read_image_times,
    read_timestamps,
)
from twin.drives.frames.video import VideoIndex, index_video
from twin.errors import DriveError

_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class FrameTimes:
    """Stamps of one camera by frame number, where they are from, how well known, and what was left out."""

    epoch_ns: IntArray
    where: str
    skipped: tuple[Skipped, ...] = ()
    warnings: tuple[str, ...] = ()
    clock: StatedClock | None = None


def times_from_file(content: bytes, file: str, pictures: Pictures | None, *, by_number: bool) -> FrameTimes:
    """Stamps of a file, brought together with the pictures where there are any.

    A video that cannot be opened costs only a warning: the stamps are what annotations need.

    Raises
    ------
    DriveError
        If the file cannot be read, or does not fit the pictures (:func:`twin.drives.frames.pairing.pair`).
    """
    if names_images(content[:HEAD_BYTES]):
        return _by_image(content, file, pictures)
    epoch_ns, skipped = read_timestamps(content, file)
    if pictures is None or not pictures.where:
        return FrameTimes(epoch_ns, file, skipped, clock=computed(epoch_ns, file))
    warnings: tuple[str, ...] = ()
    if pictures.settings.numbered:
        return _some_pictures(pictures, epoch_ns, file, skipped)
    if pictures.images is not None:
        n_frames = len(pictures.images)
    else:
        try:
            index = video_index(pictures)
        except DriveError as error:
            said = f"{error} Its frames are not counted against {file}."
            return FrameTimes(epoch_ns, file, skipped, (said,), computed(epoch_ns, file))
        n_frames, warnings = index.n_frames, _damage(index)
    paired = pair(epoch_ns, n_frames, pictures.where, file, by_number=by_number)
    return FrameTimes(
        paired.epoch_ns,
        file,
        skipped + paired.skipped,
        warnings + paired.warnings,
        computed(paired.epoch_ns, file),
    )


def times_of_pictures(pictures: Pictures) -> FrameTimes:
    """Times that the pictures carry themselves: of a container's frames, in names of images, or in EXIF tags.

    Raises
    ------
    DriveError
        If there are none, or their zone or their start is not said.
    """
    if pictures.images is None:
        return _of_container(pictures, video_index(pictures))
    if pictures.settings.numbered:
        raise DriveError(_numbers_only(pictures))
    epoch_ns = _of_images(pictures, pictures.images)
    epoch_ns, late = increasing(epoch_ns, pictures.where)
    stamped_ns = epoch_ns[epoch_ns != NO_STAMP]
    unknown = len(epoch_ns) - stamped_ns.size - sum(s.count for s in late)
    skipped = (Skipped("frames", pictures.where, unknown, "no time in name or EXIF"),) if unknown else ()
    whole = stamped_ns.size > 1 and not np.any(stamped_ns % _NS)
    if not whole:
        return FrameTimes(epoch_ns, pictures.where, skipped + late)
    cut = StatedClock(WHOLE_SECONDS_MS, f"the times of {pictures.where} are whole seconds")
    return FrameTimes(epoch_ns, pictures.where, skipped + late, (_whole(pictures.where),), cut)


def video_index(pictures: Pictures) -> VideoIndex:
    """Count the frames of a camera's video.

    Raises
    ------
    DriveError
        If it cannot be read.
    """
    with pictures.folder.open(pictures.where) as file:
        return index_video(file, pictures.where)


def _some_pictures(
    pictures: Pictures, epoch_ns: IntArray, file: str, skipped: tuple[Skipped, ...]
) -> FrameTimes:
    """All stamps stay: which frames have pictures, their names say."""
    there = np.flatnonzero([bool(image) for image in pictures.images or ()])
    beyond = int(np.count_nonzero(there >= len(epoch_ns)))
    if beyond == there.size:
        raise DriveError(
            f"Not one image of {pictures.where} is of a frame that {file} has a stamp for: it ends with frame"
            f" {len(epoch_ns) - 1:,}, the images begin with {there[0]:,}. Give the stamps of this recording."
        )
    left_out = (Skipped("frames", pictures.where, beyond, f"no stamp in {file}"),) if beyond else ()
    return FrameTimes(epoch_ns, file, skipped + left_out, clock=computed(epoch_ns, file))


def _numbers_only(pictures: Pictures) -> str:
    return (
        f"The images of {pictures.where} are numbered = true in {SETTINGS_FILE}, which says their frames but"
        " no times: give a file of stamps by frame number under [timestamps]."
    )


def _by_image(content: bytes, file: str, pictures: Pictures | None) -> FrameTimes:
    if pictures is not None and pictures.settings.numbered:
        raise DriveError(_numbers_only(pictures))
    times, skipped = read_image_times(content, file)
    if pictures is None or pictures.images is None:
        raise DriveError(
            f"{file} gives the times of images, but the pictures are a video: give stamps by frame number, or"
            f" name the folder of the images under [frames] in {SETTINGS_FILE}."
        )
    names = [image.rpartition("/")[2] for image in pictures.images]
    epoch_ns = np.array([times.get(name, NO_STAMP) for name in names], dtype=np.int64)
    unused = len(set(times) - set(names))
    if not np.any(epoch_ns != NO_STAMP):
        raise DriveError(
            f"Not one image that {file} names is in {pictures.where}: it names {next(iter(times))}, the"
            f" folder holds {names[0]}. Give the times of these images."
        )
    epoch_ns, late = increasing(epoch_ns, file)
    unknown = int(np.count_nonzero(epoch_ns == NO_STAMP)) - sum(s.count for s in late)
    left_out = [
        Skipped("time stamps", file, unused, "no picture of that name"),
        Skipped("frames", pictures.where, unknown, f"no stamp in {file}"),
    ]
    left_out = [s for s in left_out if s.count]
    return FrameTimes(epoch_ns, file, (*skipped, *late, *left_out), clock=computed(epoch_ns, file))


def _of_container(pictures: Pictures, index: VideoIndex) -> FrameTimes:
    start_ns, warnings = pictures.settings.start_ns, _damage(index)
    clock = stated_start(pictures.camera)
    if index.offset_ns is None:
        raise DriveError(
            f"{index.where} is a raw {index.codec} stream, which carries no times: add the recorder's"
            f" {index.where}.timestamps, or name a file of stamps under [timestamps] in {SETTINGS_FILE}."
        )
    if start_ns is None:
        if index.created_ns is None:
            raise DriveError(
                f"{index.where} does not say when it began: write [frames.{pictures.camera}] file ="
                f' "{index.where}" and start = "2026-06-10T07:59:59.123Z" in {SETTINGS_FILE}.'
            )
        start_ns = index.created_ns
        said = (
            f"{index.where} began by its tag creation_time, which many cameras write in local time, at the"
            f" end, or in whole seconds: state start under [frames.{pictures.camera}] in {SETTINGS_FILE}."
        )
        warnings = (*warnings, said)
        clock = StatedClock(STATED_MS, f"{index.where} began by its tag creation_time")
    epoch_ns, late = increasing(start_ns + index.offset_ns, index.where)
    return FrameTimes(epoch_ns, index.where, late, warnings, clock)


def _damage(index: VideoIndex) -> tuple[str, ...]:
    if not index.n_damaged:
        return ()
    said = (
        f"{index.where} is damaged in {index.n_damaged:,} places; frames that it lost can shift all later"
        " ones: compare a late frame with what is annotated in it."
    )
    return (said,)


def _of_images(pictures: Pictures, images: tuple[str, ...]) -> IntArray:
    """Times by name, else by EXIF; `NO_STAMP` where an image has none."""
    zone = pictures.settings.utc_offset_hours
    times = [epoch_from_name(image, zone) for image in images]
    if all(time is None for time in times):
        if any(needs_zone(image) for image in images):
            raise DriveError(_zoneless(pictures, f"the names, such as {images[0]},"))
        times = [exif_epoch(pictures.folder.head(image, HEAD_BYTES), zone) for image in images]
    if all(time is None for time in times):
        if any(exif_needs_zone(pictures.folder.head(image, HEAD_BYTES)) for image in images[:100]):
            raise DriveError(_zoneless(pictures, "the EXIF tags"))
        raise DriveError(
            f"The images of {pictures.where} do not say when they were taken, neither in their names"
            f" ({images[0]}) nor in EXIF tags: name a table image,time_ns under [timestamps] in"
            f" {SETTINGS_FILE}."
        )
    return np.array([NO_STAMP if time is None else time for time in times], dtype=np.int64)


def _zoneless(pictures: Pictures, what: str) -> str:
    return (
        f"In {pictures.where}, {what} say a time of day but not its zone: write utc_offset_hours under"
        f" [frames.{pictures.camera}] in {SETTINGS_FILE}, 0 for UTC, 2 for Norwegian summer time."
    )


def _whole(where: str) -> str:
    return (
        f"The times of {where} are whole seconds, up to a second wrong: that is 17 m at 60 km/h. Give a table"
        f" image,time_ns with fractions under [timestamps] in {SETTINGS_FILE}."
    )
