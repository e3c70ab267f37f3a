"""What `twin calibrate verify` says of its figures: what was left out, is not known, or cannot be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoloc.arrays import FloatArray, TextArray
from geoloc.calibration.verify_mounting import CameraTurn, MountingPart
from geoloc.reasons import Reason, sentence_of
from geoloc.trajectory.trajectory import Poses, Trajectory

_FEW_OBJECTS = 5
_NAMES = 5
_MOST_PART = 0.8
"""Of a common turn: where more of it is counted there is nothing to tell."""
LEAST_DEG = 0.02
"""A smaller turn is 4 mm at 12 m to the side: not worth another rig file."""
LEAST_CHANCE = 0.8
"""That a camera is nearer to the truth after it was turned: with less it stays as it is."""
_SURE_SIGMAS = 2.0
_MOST_DEG = 3.0
_MOST_MISFIT_DEG = 1.0


def doubt(turns: Mapping[str, CameraTurn]) -> str:
    """Tell of turns that no mounting has, and of objects that no turn brings to where they are seen."""
    for name, turn in turns.items():
        largest = max(abs(turn.pitch_deg), abs(turn.yaw_deg), abs(turn.roll_deg))
        if largest > _MOST_DEG or turn.after_deg > _MOST_MISFIT_DEG:
            return (
                f"{name} would turn by up to {largest:.1f}°, and then still be {turn.after_deg:.1f}°"
                f" ({turn.after_px:.0f} px) off: that is no mounting. Are all objects shifted, their"
                " coordinates in another system or their names mixed up, or is it another car's rig file?"
            )
    return ""


def without_pose(names: TextArray, poses: Poses, trajectory: Trajectory) -> list[str]:
    """Tell of annotations that are left out because the drive has no pose there, reason by reason."""
    told = []
    for reason in np.unique(poses.reason).tolist():
        mine = poses.reason == reason
        why = sentence_of(Reason(reason), max_range_m=np.nan, span_ns=trajectory.span_ns)
        objects = np.unique(names[mine]).tolist()
        more = f" and {len(objects) - _NAMES} more" if len(objects) > _NAMES else ""
        told.append(
            f"{mine.sum()} annotations of {', '.join(objects[:_NAMES])}{more} have no pose and are left out:"
            f" {why}. Give the whole recording of positions, or other objects."
        )
    return told


def left_out(misplaced: Mapping[str, float]) -> list[str]:
    """Tell of objects that lie elsewhere than the cameras see them."""
    return [
        f"Object {name} lies {metres:.1f} m from where the cameras see it, and is left out: survey it again,"
        " or look at its annotations."
        for name, metres in misplaced.items()
    ]


def shared(found: MountingPart, drive_sigma_deg: FloatArray) -> tuple[str, ...]:
    """Tell of a turn that all cameras ask for and that may as well be the drive's own."""
    told = []
    # About the rig's axes, told as of a camera that looks ahead: positive pitch looks up, positive yaw right.
    for axis, (name, pose, sign) in enumerate(
        (("roll", "roll", 1.0), ("pitch", "pitch", -1.0), ("yaw", "heading", -1.0))
    ):
        common = sign * float(found.common_deg[axis])
        part = sign * float(found.common_part_deg[axis])
        least = max(_SURE_SIGMAS * float(found.common_sigma_deg[axis]), LEAST_DEG)
        if abs(common) > least and abs(part) < _MOST_PART * abs(common):
            told.append(
                f"The cameras ask for {common:+.2f}° of {name} together, and this drive's own {pose} over the"
                f" ground is known to {drive_sigma_deg[axis]:.2f}° only: {part:+.2f}° of it is counted as"
                " their mounting."
            )
    return tuple(told)


def few(turns: Mapping[str, CameraTurn]) -> list[str]:
    """Tell that sigmas rest on few objects."""
    if not turns or min(turn.n_objects for turn in turns.values()) >= _FEW_OBJECTS:
        return []
    return [f"Fewer than {_FEW_OBJECTS} objects: the sigmas are rough, since they count how objects differ."]
