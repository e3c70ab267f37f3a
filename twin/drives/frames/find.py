"""Which video or image folder holds a camera's pictures."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath

from geoloc.rig.rig import Rig, RigCamera
from twin.drives.folder.drive_toml import SETTINGS_FILE, DriveSettings, FrameSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.sensor_names import named_in
from twin.drives.frames.images import IMAGE_SUFFIXES
from twin.drives.frames.stamp_files import MAX_FRAME, names_images, read_image_times
from twin.drives.frames.video import VIDEO_SUFFIXES
from twin.errors import DriveError

UPLOADED = re.compile(r"^[0-9a-f]{8}-(?=.)")
"""What Label Studio puts before the name of an upload: ``ab12cd34-IMG_4000.jpg``; so its exports have it."""
_DIGITS = re.compile(r"(\d{1,30})", re.ASCII)


@dataclass(frozen=True, slots=True)
class Pictures:
    """Where the pictures of one camera are.

    Attributes
    ----------
    camera : str
    folder : DriveFolder
    settings : FrameSettings
        `file` is the video or the folder of images; "" where only a table of times names the images.
    images : tuple of str or None
        Names of the images by frame number, relative to the drive folder; "" for a frame that has none,
        where the folder holds some frames of many. None for a video.
    """

    camera: str
    folder: DriveFolder
    settings: FrameSettings
    images: tuple[str, ...] | None = None

    @property
    def where(self) -> str:
        """Name of the video or folder, for messages."""
        return self.settings.file

    def has(self, frame: int) -> bool:
        """Whether there may be a picture of a frame: for certain only where these are images."""
        return self.images is None or (0 <= frame < len(self.images) and bool(self.images[frame]))

    def frame_of(self) -> Mapping[str, int]:
        """Frame number by the name of an image, with and without its suffix; empty for a video."""
        images = [(i, PurePosixPath(image)) for i, image in enumerate(self.images or ()) if image]
        return {image.stem: i for i, image in images} | {image.name: i for i, image in images}


def find_pictures(folder: DriveFolder, settings: DriveSettings, rig: Rig) -> dict[str, Pictures]:
    """Find the pictures of every camera, without opening them.

    ``[frames]`` of ``drive.toml`` says them all; without it, the video that the rig names or the one video
    that has the camera's name. Images of which only a table of times knows count as well: their names tell
    the frame numbers.

    Raises
    ------
    DriveError
        If what ``drive.toml`` names is not there.
    """
    pictures: dict[str, Pictures] = {}
    for camera in rig.cameras.values():
        if settings.frames is None:
            name = _video_of(folder, camera)
            frames = FrameSettings(name) if name else None
        else:
            frames = settings.frames.get(camera.name)
        if frames is not None:
            pictures[camera.name] = _pictures(folder, camera.name, frames)
            continue
        file = settings.timestamps.get(camera.name)
        if file and folder.has(file) and names_images(folder.head(file)):
            times, _ = read_image_times(folder.peek(file), file)
            pictures[camera.name] = Pictures(camera.name, folder, FrameSettings(""), in_order(times))
    return pictures


def in_order(names: Mapping[str, int] | list[str]) -> tuple[str, ...]:
    """Image names in the order of their frames: alphabetical, numbers by value, so that 9 is before 10.

    What Label Studio drew by lot before the names of pictures that come back from it says no order.
    """
    paths = {name: PurePosixPath(name) for name in names}
    lots = [UPLOADED.match(path.name) for path in paths.values()]
    are_lots = all(lots) and not all(lot[0][:8].isdecimal() for lot in lots if lot)

    def order(name: str) -> tuple[list[tuple[int, str]], str]:
        bare = str(paths[name].with_name(UPLOADED.sub("", paths[name].name))) if are_lots else name
        return [_part(p) for p in _DIGITS.split(bare)], name

    return tuple(sorted(names, key=order))


def _part(text: str) -> tuple[int, str]:
    return (int(text), "") if text.isascii() and text.isdigit() else (-1, text.casefold())


def _pictures(folder: DriveFolder, camera: str, frames: FrameSettings) -> Pictures:
    if not folder.is_folder(frames.file):
        if not folder.has(frames.file):
            raise DriveError(
                f"{frames.file} is not in {folder.root}: [frames] in {SETTINGS_FILE} must name a video or a"
                " folder of images."
            )
        return Pictures(camera, folder, frames)
    images = in_order(folder.names_in(frames.file, *IMAGE_SUFFIXES))
    if not images:
        raise DriveError(
            f"The folder {frames.file} holds no images ({', '.join(IMAGE_SUFFIXES)}): name the folder that"
            f" holds those of {camera} under [frames] in {SETTINGS_FILE}."
        )
    if len(images) > MAX_FRAME:
        raise DriveError(f"The folder {frames.file} holds {len(images):,} images: split the drive.")
    return Pictures(camera, folder, frames, _by_number(images, frames.file) if frames.numbered else images)


def _by_number(images: tuple[str, ...], where: str) -> tuple[str, ...]:
    """Put images at the last number in their names; frames between them have none."""
    names: dict[int, str] = {}
    for image in images:
        digits = _DIGITS.findall(PurePosixPath(image).stem)
        number = int(digits[-1]) if digits else -1
        if not 0 <= number <= MAX_FRAME or number in names:
            said = "says no frame number" if number < 0 else f"says frame {number:,}"
            said += f", as {names[number]} does" if number in names else ""
            raise DriveError(
                f"{image} {said}: with numbered = true for {where} in {SETTINGS_FILE}, each image is named"
                " after its frame, as 000012.jpg."
            )
        names[number] = image
    return tuple(names.get(number, "") for number in range(max(names) + 1))


def _video_of(folder: DriveFolder, camera: RigCamera) -> str | None:
    """The video that the rig names, else the only one that has the camera's name."""
    named = folder.found(camera.video)
    if named:
        return named
    videos = [name for name in folder.names(*VIDEO_SUFFIXES) if named_in(name, [camera.name])]
    return videos[0] if len(videos) == 1 else None
