"""Pictures and films of a drive with everything drawn in: masked unless asked otherwise."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np

from geoloc.arrays import IntArray
from geoloc.rig.rig import RigCamera
from twin.drives.frames.read import Frame
from twin.drives.frames.stamp_files import NO_STAMP
from twin.errors import ConfigError, DriveError, MissingExtraError
from twin.evidence.crops import GapKind
from twin.evidence.cutting import corners, faces_of
from twin.evidence.masker import Masker
from twin.evidence.masks import BY_GEOMETRY, BY_NETWORK, Image, Regions, filled, masked
from twin.evidence.recordings import Lack, Recordings, recordings_of
from twin.evidence.sights import Marked, Sight, sight_of
from twin.overlay.draw import Facts, drawn
from twin.overlay.lines import FrameLines, lines_of
from twin.overlay.scene import Click, DriveScene, Standing
from twin.store.atomic_files import replace_file
from twin.store.folders import make_folder
from twin.words import Lang, gap_sentence

Progress = Callable[[str], None]

PICTURES, FILMS = (".png", ".jpg", ".jpeg", ".webp"), (".mp4",)
_AROUND_FRAMES = 15
"""A film begins so many frames before an object is first annotated, and ends as many after the last."""
_TELL_EVERY = 30


@dataclass(frozen=True, slots=True)
class Asked:
    """Which pictures of which camera, and how they are to be shown."""

    camera: str
    frames: IntArray
    masker: Masker | None = None
    is_masked: bool = True
    lang: Lang = Lang.EN


def check_name(path: Path, endings: Sequence[str]) -> None:
    """Refuse a name by which it is not known what to write.

    Raises
    ------
    ConfigError
    """
    if path.suffix.lower() not in endings:
        raise ConfigError(f"{path}: let its name end in {', '.join(endings)}.")


def nearest_frame(scene: DriveScene, name: str | None, camera: str | None) -> tuple[str, int]:
    """Return the camera and the last frame of it in which an object was annotated and which has a picture.

    Raises
    ------
    ConfigError
        A drive was asked for, or that camera has no annotation of the object.
    """
    if name is None:
        raise ConfigError(
            f"{scene.name} is a drive: name the picture, --frame CAMERA:NUMBER ({_cameras(scene)})."
        )
    of_camera = scene.frames_of(name)
    if camera is not None and camera not in of_camera:
        seen = ", ".join(sorted(of_camera)) or "none"
        raise ConfigError(f"{camera} has no annotation of {name}; cameras that have one: {seen}.")
    best = camera or max(sorted(of_camera), key=lambda one: len(of_camera[one]))
    recording = recordings_of(scene.name, scene.folder, scene.rig)
    there = [frame for frame in of_camera[best].tolist() if recording.has(best, frame)]
    return best, (there or of_camera[best].tolist())[-1]


def approach(scene: DriveScene, name: str | None, camera: str | None) -> tuple[str, IntArray]:
    """Return the camera and the frames of a film: those around an object's annotations, or the whole drive.

    Raises
    ------
    ConfigError
        A drive was asked for without a camera.
    """
    if name is None:
        if camera is None:
            raise ConfigError(f"{scene.name} is a drive: name the camera, --camera ({_cameras(scene)}).")
        scene.camera(camera)
        return camera, np.zeros(0, np.int64)
    best, _ = nearest_frame(scene, name, camera)
    seen = scene.frames_of(name)[best]
    return best, np.arange(max(int(seen[0]) - _AROUND_FRAMES, 0), int(seen[-1]) + _AROUND_FRAMES + 1)


def write_picture(scene: DriveScene, asked: Asked, path: Path) -> Path:
    """Draw one picture and write it.

    Raises
    ------
    ConfigError
        The name has another ending.
    DriveError
        The picture is not there.
    """
    from PIL import Image as Pillow

    check_name(path, PICTURES)
    for _, image, _ in _frames(scene, asked, _silent):
        file = io.BytesIO()
        kind = {".jpg": "JPEG", ".jpeg": "JPEG"}.get(path.suffix.lower(), path.suffix[1:].upper())
        Pillow.fromarray(image).save(file, kind, quality=92)
        make_folder(path.parent)
        replace_file(path, file.getvalue())
    return path


def write_film(scene: DriveScene, asked: Asked, path: Path, progress: Progress) -> int:
    """Draw pictures one after the other into an MP4 film of H.264, at the speed of the recording.

    Returns
    -------
    int
        How many pictures are in it.

    Raises
    ------
    ConfigError
        The name has another ending.
    DriveError
        The pictures are not there, or PyAV is not installed.
    """
    check_name(path, FILMS)
    try:
        import av
    except ImportError as error:
        raise MissingExtraError(f"The film {path}", "PyAV", "video") from error
    file, n = io.BytesIO(), 0
    with av.open(file, "w", format="mp4") as container:
        stream = None
        for frame, image, rate in _frames(scene, asked, progress):
            if stream is None:
                stream = container.add_stream(
                    "libx264", rate=rate, options={"crf": "21", "preset": "veryfast"}
                )
                stream.height, stream.width = image.shape[:2]
                stream.pix_fmt = "yuv420p"
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")):
                container.mux(packet)
            n += 1
            if n % _TELL_EVERY == 0:
                progress(f"{asked.camera}: {n:,} pictures drawn, up to frame {frame.number:,}")
        if stream is not None:
            for packet in stream.encode():
                container.mux(packet)
    make_folder(path.parent)
    replace_file(path, file.getvalue())
    return n


def _silent(_text: str) -> None:
    pass


def _frames(scene: DriveScene, asked: Asked, progress: Progress) -> Iterator[tuple[Frame, Image, Fraction]]:
    """Decode, mask and draw the pictures that were asked for; at least one, or it says why none."""
    recording = recordings_of(scene.name, scene.folder, scene.rig)
    stamps = _stamps(recording, asked.camera)
    wanted = asked.frames if asked.frames.size else np.arange(stamps.size)
    wanted = wanted[(wanted < stamps.size)]
    wanted = wanted[stamps[wanted] != NO_STAMP]
    camera, rate, n = scene.camera(asked.camera), _rate(stamps), 0
    lacks: list[Lack] = []
    progress(f"{scene.name}, {asked.camera}: {wanted.size:,} pictures")
    for frame in recording.decoded(asked.camera, wanted.tolist(), lacks):
        if frame.image.shape[:2] != (camera.model.height_px, camera.model.width_px):
            raise DriveError(
                f"{scene.name}: the pictures of {asked.camera} are {frame.image.shape[1]} x"
                f" {frame.image.shape[0]} pixels, its calibration is for {camera.model.width_px} x"
                f" {camera.model.height_px}: give the recording that it was calibrated at."
            )
        epoch_ns = int(stamps[frame.number])
        lines = lines_of(scene, asked.camera, frame.number, epoch_ns)
        shown = _masked(camera, frame, lines, asked.masker) if asked.is_masked else frame.image
        facts = Facts(scene.name, scene.method, asked.camera, frame.number, epoch_ns, asked.is_masked)
        yield frame, drawn(shown, lines, facts, asked.lang), rate
        n += 1
    if not n:
        why = "; ".join(gap_sentence(lack.why) for lack in lacks) or "there is no such picture"
        raise DriveError(f"{scene.name}, {asked.camera}: no picture to draw on: {why}")


def _stamps(recording: Recordings, camera: str) -> IntArray:
    if recording.lack is not None and recording.lack.kind is GapKind.NO_PICTURES:
        raise DriveError(
            f"{recording.name} has no pictures where it was read from: add its videos or pictures there, or"
            " ingest the folder that has them."
        )
    if recording.lack is not None:
        raise DriveError(gap_sentence(recording.lack.why))
    if camera not in recording.pictures:
        there = ", ".join(sorted(recording.pictures))
        raise DriveError(f"{recording.name} has no pictures of {camera}: it has those of {there}.")
    stamps = recording.stamps(camera)
    if isinstance(stamps, Lack):
        raise DriveError(gap_sentence(stamps.why))
    return stamps


def _rate(stamps: IntArray) -> Fraction:
    """Pictures a second, from the stamps' median step."""
    step = np.diff(stamps[stamps != NO_STAMP])
    median = float(np.median(step[step > 0])) if (step > 0).any() else 1e9 / 30
    return Fraction(1e9 / median).limit_denominator(1000)


def _masked(
    camera: RigCamera,
    frame: Frame,
    lines: FrameLines | None,
    masker: Masker | None,
) -> Image:
    """Hide everything but the signs' faces, by the rules of the crops of findings."""
    shape = frame.image.shape[0], frame.image.shape[1]
    found = None if masker is None else masker.find(frame.image, (0, 0, shape[1], shape[0]))
    faces, focal_px, px_per_m = [], camera.model.width_px / 2.0, 1.0
    for what, sight, marked in () if lines is None else _annotated(camera, lines):
        faces += list(faces_of(frame.image, sight, marked, what.codes)[0])
        focal_px, px_per_m = max(focal_px, sight.focal_px), max(px_per_m, sight.px_per_m)
    boxes = [] if found is None else [corners(np.array(box)) for box in found.boxes_px]
    nothing = np.zeros(shape, dtype=np.bool_)
    regions = Regions(faces=filled(shape, faces), window=nothing, found=filled(shape, boxes))
    limits = BY_GEOMETRY if found is None else BY_NETWORK
    return masked(frame.image, regions, limits, focal_px, px_per_m).image


def _annotated(camera: RigCamera, lines: FrameLines) -> Iterator[tuple[Standing, Sight, Marked]]:
    """Give what was annotated of each estimated object in a picture, and where its face should be."""
    for shown in lines.estimates:
        mine = [click for click in lines.clicks if click.object == shown.what.object]
        if mine:
            what, marked = shown.what, _marked_of(mine)
            sight = sight_of(camera, lines.pose, what.place, is_face=what.is_face, marked=marked)
            if sight is not None:
                yield what, sight, marked


def _marked_of(clicks: Sequence[Click]) -> Marked:
    feet = [click.pixel_px for click in clicks if click.is_foot]
    faces = [click for click in clicks if not click.is_foot]
    return Marked(
        foot_px=feet[0] if feet else None,
        boxes_px=tuple(click.box_px for click in faces if click.box_px is not None),
        centres_px=tuple(click.pixel_px for click in faces if click.box_px is None),
    )


def _cameras(scene: DriveScene) -> str:
    return f"cameras: {', '.join(sorted(scene.rig.cameras))}"
