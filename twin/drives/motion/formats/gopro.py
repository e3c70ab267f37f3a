"""The gyro of a GoPro, in its own videos: which axis points up depends on the model and how it is mounted.

Its samples have no time but their packet's, since the first frame; that frame's UTC is what the fixes in the
video say (:mod:`twin.drives.track.formats.gpmf`).
"""

from __future__ import annotations

from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSource, Quantity
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.clocks import counted_from
from twin.drives.motion.samples import MotionRead, Samples
from twin.drives.track.formats.gpmf import gyro_of_video, is_gopro_video, start_by_gps
from twin.drives.track.formats.recording import Recording
from twin.errors import DriveError

NAME = "GYRO"


def is_gopro(folder: DriveFolder, source: MotionSource) -> bool:
    """Whether a file is a video with GoPro's own data."""
    return is_gopro_video(Recording(folder, source.file))


def read(folder: DriveFolder, source: MotionSource) -> MotionRead:
    """Read the rate of turn.

    Raises
    ------
    DriveError
        If the video has no gyro, nothing says when it began, or anything else is asked of it.
    """
    if source.names not in ((), (NAME,)) or any(q is not Quantity.TURN_RATE for q in source.named):
        raise DriveError(
            f"{source.file} is a GoPro video, of whose motion twin reads the gyro alone: take the names under"
            f' [{source.table}] in {SETTINGS_FILE} out, or give turn_rate = "{NAME}".'
        )
    recording = Recording(folder, source.file)
    folder.enter(source.file, recording.head)
    gyro = gyro_of_video(recording)
    if gyro is None:
        raise DriveError(f"{source.file} has no gyro: take it out of [{source.table}] in {SETTINGS_FILE}.")
    start = start_by_gps(recording) if source.time_zero_ns is None else None
    if start is None:
        stamp_ns = counted_from(gyro.offset_ns, source, f"{gyro.offset_ns[0] / 1e9:.3f}")
        return MotionRead({Quantity.TURN_RATE: [Samples(stamp_ns, gyro.rates, unit=gyro.unit)]})
    samples = Samples(
        gyro.offset_ns + start.epoch_ns,
        gyro.rates,
        unit=gyro.unit,
        of_receiver=True,
        stamp_sigma_s=start.sigma_s,
    )
    return MotionRead({Quantity.TURN_RATE: [samples]})
