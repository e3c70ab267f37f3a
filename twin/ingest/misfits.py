"""Whether a drive fits itself, and whether a sign that it did not see can be gone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from geoloc.adjustment.result import Adjusted, AdjustmentDoubt
from geoloc.adjustment.scene import sigma_px_of
from geoloc.arrays import BoolArray
from geoloc.doubts import Doubt
from geoloc.locate.single_frame import ErrorBudget
from geoloc.reasons import Reason, stands_far_away
from geoloc.trajectory.trajectory import Trajectory
from twin import words
from twin.drives.drive import Drive
from twin.drives.folder.notes import DriveDoubt, SkipKind
from twin.ingest.locate import SightedObjects, adjust_camera
from twin.words import reasons

_MOST_TURN_DEG = 1.0
_MOST_OUTLIERS = 0.15
"""Simulated and real drives whose cameras are right stay below 2 %."""
_FAR_SIGMAS = 6.0
"""What white noise of three times the stated sigma exceeds in one annotation of twenty."""
_MOST_FAR = 0.05
_LATE_SIGMAS = 4.0
_FEW_OBJECTS = 3
_MOST_LOST = 0.3


@dataclass(frozen=True, slots=True)
class Misfit:
    """Why the positions of a drive cannot be trusted.

    Attributes
    ----------
    kind : reasons.Misfit
        With its facts, for findings.
    sentence : str
        The same in English, with its cure.
    """

    kind: reasons.Misfit
    sentence: str

    @property
    def what(self) -> str:
        """A clause in English: ``wide is turned by 4.5°``."""
        return words.sentence(self.kind)


def misfits_of(
    drive: Drive, sighted: SightedObjects, budget: ErrorBudget, id_doubts: tuple[Doubt, ...] = ()
) -> tuple[Misfit, ...]:
    """Find out why the positions of a drive cannot be trusted.

    Only the adjustment can tell: a method of single frames has nothing to compare a sighting with.

    Parameters
    ----------
    id_doubts : tuple of Doubt
        What :func:`twin.drives.objects.identify.id_warnings` said.

    Returns
    -------
    tuple of Misfit
        Empty for a drive that fits itself.
    """
    adjusted = sighted.adjusted
    if adjusted is None:
        return ()
    found = [*_clock_and_shutter(adjusted), *turned_cameras(adjusted, budget.boresight_deg)]
    found += [
        Misfit(reasons.CamerasDisagree(), doubt.sentence)
        for doubt in id_doubts
        if doubt.kind is DriveDoubt.CAMERAS_DISAGREE
    ]
    # One cause is enough: what is turned or late also makes outliers.
    return tuple(found or [*_outliers(drive, sighted, adjusted), *_poor_cameras(drive, sighted, budget)])


def clocks_apart(
    doubts: tuple[Doubt, ...], drive: Drive, trajectory: Trajectory, budget: ErrorBudget
) -> tuple[Doubt, ...]:
    """Add to the doubt that cameras disagree which clock is late, where each camera alone shows it.

    Other doubts come back as they are. A clock that is stated to the second is found by each camera, and is
    no doubt of the adjustment: what counts is whether the camera shows that it is late.
    """
    if not any(doubt.kind is DriveDoubt.CAMERAS_DISAGREE for doubt in doubts):
        return doubts
    notes, late = drive.annotations, []
    for camera in np.unique(notes.camera).tolist():
        clock = adjust_camera(drive, trajectory, camera, budget).time_offset_ms
        if abs(clock.value) > _LATE_SIGMAS * clock.sigma:
            late.append(f"{camera} alone fits the track with {clock.value:+.0f} ± {clock.sigma:.0f} ms.")
    return tuple(
        replace(doubt, sentence=" ".join((doubt.sentence, *late)))
        if doubt.kind is DriveDoubt.CAMERAS_DISAGREE
        else doubt
        for doubt in doubts
    )


def _clock_and_shutter(adjusted: Adjusted) -> Iterator[Misfit]:
    for doubt in adjusted.doubts:
        if doubt.kind == AdjustmentDoubt.CLOCK:
            yield Misfit(reasons.ClockOff(abs(adjusted.time_offset_ms.value)), doubt.sentence)
        elif doubt.kind == AdjustmentDoubt.SHUTTER:
            yield Misfit(reasons.ShutterImpossible(), doubt.sentence)


def turned_cameras(adjusted: Adjusted, mounted_deg: float = 0.0) -> Iterator[Misfit]:
    """Tell of cameras that sit otherwise than their calibration says, far beyond what a mount gives way.

    `mounted_deg` is how well the mounting is stated, one sigma: one that is known by eye may be off.
    """
    for camera, turns in adjusted.boresight_deg.items():
        worst = max(turns, key=lambda turn: abs(turn.value))
        if abs(worst.value) > max(_MOST_TURN_DEG, 5.0 * worst.sigma, _LATE_SIGMAS * mounted_deg):
            turned = reasons.CameraTurned(camera, abs(worst.value))
            yield Misfit(
                turned,
                f"{words.sentence(turned)} ± {worst.sigma:.1f}° against its stated angles: check their signs,"
                " units and order (roll_pitch_yaw), or calibrate it anew.",
            )


def _outliers(drive: Drive, sighted: SightedObjects, adjusted: Adjusted) -> Iterator[Misfit]:
    """Tell of a drive in which too many sightings contradict the others."""
    rows = _telling(drive, sighted)
    outlier = adjusted.rejected[rows] == Reason.OUTLIER
    tried = int((outlier | adjusted.used[rows]).sum())
    if outlier.sum() > _MOST_OUTLIERS * tried:
        outliers = int(outlier.sum())
        yield Misfit(
            reasons.SightingsContradict(outliers, tried),
            f"{outliers:,} of {tried:,} sightings contradict the others: check calibration, mounting"
            " and clock of each camera, and that pictures and annotations are of this drive.",
        )


def _poor_cameras(drive: Drive, sighted: SightedObjects, budget: ErrorBudget) -> Iterator[Misfit]:
    """Tell of cameras whose annotations lie far from where all others place them, at most objects."""
    if sighted.adjusted is None:
        return
    notes, rows = drive.annotations, _telling(drive, sighted)
    sigma_px = sigma_px_of(budget, notes.box_px[sighted.index, 3] - notes.box_px[sighted.index, 1])
    off_px = np.abs(sighted.adjusted.residual_px).max(axis=1)
    for camera in np.unique(notes.camera).tolist():
        mine = rows & (notes.camera[sighted.index] == camera) & np.isfinite(off_px)
        far = off_px[mine] > _FAR_SIGMAS * sigma_px[mine]
        objects = notes.object[sighted.index][mine]
        of_all, hit = np.unique(objects).size, np.unique(objects[far]).size
        if far.sum() > _MOST_FAR * mine.sum() and hit >= _FEW_OBJECTS and hit > 0.5 * of_all:
            px = float(np.quantile(off_px[mine], 1 - _MOST_FAR))
            yield Misfit(
                reasons.CameraPoor(camera),
                f"{camera} does not fit: {int(far.sum()):,} of its {int(mine.sum()):,} annotations lie far"
                f" from where the drive places them ({px:.0f} px and more for one in twenty), at {hit} of"
                f" {of_all} objects; check its calibration (model, size), or that of the other cameras.",
            )


def _telling(drive: Drive, sighted: SightedObjects) -> BoolArray:
    """Sightings (n,) that tell of a camera: feet, and where it has none, boxes.

    The middle of a box hops from plate to plate of a pole; a foot does not.
    """
    camera = drive.annotations.camera[sighted.index]
    with_feet = np.unique(camera[sighted.is_foot])
    return np.asarray(sighted.is_foot | ~np.isin(camera, with_feet))


def absence_gap(drive: Drive, sighted: SightedObjects) -> str:
    """Say why signs that a completely annotated drive did not see may stand all the same; "" if they cannot.

    A drive whose annotations were not found, not read or not located, by 30 % of a file or of a camera, says
    nothing of signs that it did not see. A sound file without any annotation does: none was in view.
    """
    if any(doubt.kind is DriveDoubt.NO_ANNOTATION_FILES for doubt in drive.warnings):
        return "it has no annotation file"
    damaged = sum(s.count for s in drive.skipped if s.kind is SkipKind.DAMAGED_FILE)
    if damaged:
        return f"{damaged:,} of its annotation files are damaged"
    return _left_out(drive) or _not_located(drive, sighted)


def _left_out(drive: Drive) -> str:
    """Files of which too much was not read."""
    lost: Counter[str] = Counter()
    for skipped in drive.skipped:
        # Repeats, slips and shapes of other kinds are no sign that was not read.
        if skipped.kind is SkipKind.UNUSABLE:
            lost[skipped.where] += skipped.count
    kept = Counter(drive.annotations.file.tolist()) + Counter(drive.interpolated.file.tolist())
    for file, count in sorted(lost.items()):
        if count > _MOST_LOST * (kept[file] + count):
            return f"{count:,} of {kept[file] + count:,} annotations in {file} were left out"
    return ""


def _not_located(drive: Drive, sighted: SightedObjects) -> str:
    """Cameras of which too much has no place."""
    is_sign = drive.is_sign()[sighted.index]
    camera, objects = (v[sighted.index] for v in (drive.annotations.camera, drive.annotations.object))
    located = sighted.reasons == ""
    if sighted.adjusted is None:  # one frame locates nothing beyond flat ground's reach
        located |= stands_far_away(sighted.located.rejected)
    for name in np.unique(camera).tolist():
        mine = is_sign & (camera == name)
        for what, n, of_all in (
            ("annotations", int((mine & located).sum()), int(mine.sum())),
            ("annotated objects", np.unique(objects[mine & located]).size, np.unique(objects[mine]).size),
        ):
            if of_all - n > _MOST_LOST * of_all:
                return f"only {n:,} of {of_all:,} {what} of {name} could be located"
    return ""
