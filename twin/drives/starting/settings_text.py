"""``drive.toml`` of a small camera: every value with its reason beside it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime

from twin.drives.folder.drive_toml import read_settings
from twin.drives.folder.nominal_lens import lens_called
from twin.drives.starting.found import Found
from twin.errors import ConfigError, DriveError

HEIGHT_M, LOWEST_M, HIGHEST_M = 1.3, 0.3, 4.5
"""Of a camera behind the windscreen of a passenger car, and between which one can be."""
UNKNOWN_FOV_DEG, UNKNOWN_SIGMA = 110.0, 0.15
"""Small cameras see 60 to 125° across: a focal length that is 15 % off is one sigma."""
AHEAD_M = 1.5
MOUNTED_DEG = 3.0
_TAPED_M, _GUESSED_M = 0.10, 0.15
"""By tape, from the road to a lens behind the windscreen; the drive itself hardly shows a wrong height."""
LARGEST_CLOCK_S = 60.0
_RECEIVER = "receiver"


@dataclass(frozen=True, slots=True)
class Answers:
    """What a person says of a recording; the defaults are of one who says nothing.

    Attributes
    ----------
    lens : str
        A name of the table of common cameras, a field of view in degrees, a calibration file of the folder,
        or "" for nothing known.
    height_m : float or None
        Of the camera over the road; None for one that is guessed.
    start_ns : int or None
        When the video began; None as it was found.
    clock_s : float
        One sigma of that.
    annotations : str
        A file in the folder; "" for those that are found, or none yet.
    complete : bool
        Whether every sign in view is, or will be, annotated.
    """

    lens: str = ""
    height_m: float | None = None
    start_ns: int | None = None
    clock_s: float = 1.0
    annotations: str = ""
    complete: bool = False


def usual_answers(found: Found) -> Answers:
    """Return what is taken where a person says nothing."""
    lens = found.calibrations[0] if len(found.calibrations) == 1 else found.lens or ""
    return Answers(lens=lens, clock_s=found.start_sigma_s)


def settings_text(found: Found, answers: Answers) -> str:
    """Write ``drive.toml``.

    Raises
    ------
    ConfigError
        An answer that cannot be: a height that no camera has, a lens that is none, no start.
    DriveError
        There is nothing that says where the car was.
    """
    if found.track is None:
        raise DriveError(no_track(found.video))
    _check(found, answers)
    camera, width, height = found.camera, *found.size_px
    position = [AHEAD_M, 0.0, HEIGHT_M if answers.height_m is None else answers.height_m]
    height_why = "guessed: measure it" if answers.height_m is None else "as you said"
    lens_lines, lens_errors = _lens(found, answers)
    complete_why = "every sign pole in view is annotated" if answers.complete else "say true when all are"
    lines = [
        "# Written by twin init. Every line may be changed; twin help drive-folder explains them all.",
        f"annotations_complete = {_toml(answers.complete)}   # {complete_why}",
        "",
        f"[cameras.{camera}]",
        *lens_lines,
        f"# metres ahead of the rear axle, to the left, over the road; the height is {height_why}",
        f"position = {position}",
        f"roll_pitch_yaw = [0.0, 0.0, 0.0]   # level and straight ahead, to {MOUNTED_DEG:g}°",
        *([f"# pictures are {width} x {height}"] if "size" not in "".join(lens_lines) else []),
        "",
        f"[frames.{camera}]",
        f"file = {_toml(found.video)}   # the only video belongs to the only camera",
        *_start(found, answers),
        "",
        *_track(found, position),
        *_annotations(camera, answers),
        "[errors]   # one sigma of what nobody measured; twin help error-budget",
        f"time_ms = {1e3 * answers.clock_s:g}   # of the camera's clock against that of the GNSS",
        f"boresight_deg = {MOUNTED_DEG:g}   # how the camera looks, by eye",
        f"camera_position_m = {_GUESSED_M if answers.height_m is None else _TAPED_M:g}   # where it sits",
        *lens_errors,
    ]
    text = "\n".join(lines) + "\n"
    read_settings(text.encode())  # what is written must be what is read
    return text


def no_track(video: str) -> str:
    """Say what to do where nothing says where the car was."""
    return (
        f"Nothing says where the car was: {video} holds no GNSS track that twin reads (it reads GoPro's), and"
        " no recording lies beside it. Export the track as GPX with the camera's own program (dashcams of"
        " Viofo, Nextbase, Garmin and others keep it inside the video; exiftool -ee -p gpx.fmt writes it too)"
        " or record one with a telephone, and copy it into the folder."
    )


def _check(found: Found, answers: Answers) -> None:
    height = answers.height_m
    if height is not None and not LOWEST_M <= height <= HIGHEST_M:
        raise ConfigError(
            f"A camera {height:g} m over the road is on no car: give metres from {LOWEST_M:g} to"
            f" {HIGHEST_M:g}."
        )
    if not 0.001 <= answers.clock_s <= LARGEST_CLOCK_S:
        raise ConfigError(
            f"The camera's clock cannot be known to {answers.clock_s:g} s: give seconds from 0.001 to"
            f" {LARGEST_CLOCK_S:g}; a zone of hours is corrected by --start."
        )
    if answers.start_ns is None and found.start is None:
        raise ConfigError(
            f"{found.video} does not say when it began, neither in its tags nor in its name: give --start"
            ' "2026-06-10T09:59:59+02:00", the instant of its first picture.'
        )
    if answers.start_ns is None and found.start is not None and not found.start.fits:
        raise ConfigError(
            f"{found.video} would lie outside the track {found.track}: its start is known by"
            f' {found.start.why}. Give --start "2026-06-10T09:59:59+02:00", the instant of its first picture,'
            " or the track of this drive."
        )


def _lens(found: Found, answers: Answers) -> tuple[list[str], list[str]]:
    """Lines of the lens, and of ``[errors]`` for it."""
    said, (width, height) = answers.lens.strip(), found.size_px
    size = f"size = [{width}, {height}]   # of the pictures"
    if said in found.calibrations:
        return [f"intrinsics = {_toml(said)}   # a calibration of this camera"], []
    if not said:
        unknown = f"fov_deg = {UNKNOWN_FOV_DEG:g}   # unknown: a guess, see focal_share below"
        return [unknown, size], [f"focal_share = {UNKNOWN_SIGMA:g}   # the focal length is a guess"]
    try:
        fov_deg = float(said.rstrip("°"))
    except ValueError:
        try:
            lens = lens_called(said)
        except DriveError as error:
            raise ConfigError(str(error)) from error
        return [f"lens = {_toml(lens.name)}   # to {lens.focal_sigma:.0%}: {lens.source}", size], []
    return [f"fov_deg = {fov_deg:g}   # across the longer side of the picture, as you said", size], []


def _start(found: Found, answers: Answers) -> list[str]:
    if answers.start_ns is not None:
        return [f"start = {_toml(_instant(answers.start_ns))}   # as you said"]
    if found.start is None:
        return []
    return [f"start = {_toml(_instant(found.start.epoch_ns))}   # {found.start.why}"]


def _track(found: Found, position: list[float]) -> list[str]:
    if found.is_poses:
        return ["[poses]", f"file = {_toml(found.track)}   # full poses; their sigmas are estimated", ""]
    at = "its own GNSS" if found.track == found.video else "the only recording"
    return [
        "[gnss]",
        f"files = {{ {_RECEIVER} = {_toml(found.track)} }}   # {at}",
        "# taken as beside the camera: a metre is little for such a receiver",
        f"lever_arms = {{ {_RECEIVER} = {position} }}",
        "",
    ]


def _annotations(camera: str, answers: Answers) -> list[str]:
    if not answers.annotations:
        return []
    return ["[annotations]", f"{camera} = {_toml(answers.annotations)}   # as you said", ""]


def _instant(epoch_ns: int) -> str:
    moment = datetime.fromtimestamp(epoch_ns // 1_000_000_000, UTC)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{epoch_ns // 1_000_000 % 1000:03d}Z"


def _toml(value: object) -> str:
    """A value as TOML has it; its texts are those of JSON."""
    return json.dumps(value, ensure_ascii=False)
