"""What is told of poses that do not say how good they are."""

from __future__ import annotations

import math

from geoloc.doubts import Doubt
from geoloc.trajectory.pose_noise import PoseSigmas
from twin.drives.folder.drive_toml import POSE_SIGMAS, SETTINGS_FILE
from twin.drives.folder.notes import DriveDoubt, doubts

_WHAT = ("{:.2f} m", "{:.2f} m in height", "{:.2f}° in roll and pitch", "{:.2f}° in heading")


def pose_sigma_doubts(taken: PoseSigmas | None, *, adjusted: bool = False) -> tuple[Doubt, ...]:
    """Say what poses without sigmas were taken as, and how to state them.

    Parameters
    ----------
    taken : PoseSigmas or None
        NaN for what the poses state; None where they state all.
    adjusted : bool
        Whether the bearings had a say in it.
    """
    if taken is None:
        return ()
    named = [
        (what.format(sigma), key)
        for what, sigma, key in zip(_WHAT, taken, POSE_SIGMAS, strict=True)
        if math.isfinite(sigma)
    ]
    sigmas, keys = (_listed([part[i] for part in named]) for i in (0, 1))
    bearings = ", and from the bearings" if adjusted else ""
    return doubts(
        DriveDoubt.TRACK,
        f"The poses state no sigmas: taken as {sigmas} (one sigma), from how the track trembles and"
        f" steps aside from its own heading{bearings}. An error that is the same all the way shows in none"
        f" of it: state {keys} under [poses] in {SETTINGS_FILE}.",
    )


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
