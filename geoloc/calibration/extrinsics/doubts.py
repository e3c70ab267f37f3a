"""What makes a calibration of extrinsics doubtful: a floor, a tag, a tape, a camera."""

from __future__ import annotations

import numpy as np

from geoloc.calibration.extrinsics.bent_board import bends
from geoloc.calibration.extrinsics.calibrate import CameraPose, Extrinsics
from geoloc.calibration.extrinsics.contradiction import FAIR_PX
from geoloc.calibration.extrinsics.outliers import MISPLACED_SIGMAS

OPEN_M, OPEN_DEG = 1.0, 2.0
"""Sigmas from which a part of a pose counts as not determined."""
_SURE = 3.0
_LEAST_SCALE = 0.003
_MISFIT = 3.0
"""Residuals of one tag, or of one camera, this many times the usual ones."""
_WEAK_DEG, _WEAK_M = 0.05, 0.02
_LEAST_MISFIT_PX = 0.15
"""Three times what the sharpest pictures are counted as (0.05 px)."""


def is_determined(camera: CameraPose) -> bool:
    """Whether the tags leave no part of a camera's pose open."""
    return not _uncertain_parts(camera, OPEN_DEG, OPEN_M)


def doubts(result: Extrinsics) -> tuple[str, ...]:
    """Everything that a person should look at before the result is used, one sentence each.

    Parameters
    ----------
    result : Extrinsics

    Returns
    -------
    tuple of str
        What (which tag, camera, or the floor), how much, and the cure.
    """
    cameras = [*_lost_cameras(result), *_open_cameras(result), *_weak_cameras(result), *_blurred(result)]
    tags = [
        *_misfits(result),
        *_bent(result),
        *_misplaced(result),
        *_sizes(result),
        *_scale(result),
        *_floor(result),
    ]
    return (*cameras, *tags)


def _lost_cameras(result: Extrinsics) -> list[str]:
    on_car = {s.camera for s in result.sightings if s.view == s.camera}
    return [
        f"{camera}: none of its tags fits those of the other cameras, so nothing is known of it: see that"
        " no tag was moved between the pictures, and that its intrinsics are right."
        for camera in sorted(on_car - result.cameras.keys())
    ]


def _open_cameras(result: Extrinsics) -> list[str]:
    return [
        f"{camera.camera}: {_are(_uncertain_parts(camera, OPEN_DEG, OPEN_M))} not determined: measure the"
        " places of at least three tags that it sees, not on one line, or put tags on the floor and on the"
        " wheels."
        for camera in result.cameras.values()
        if not is_determined(camera)
    ]


def _weak_cameras(result: Extrinsics) -> list[str]:
    sentences = []
    for camera in result.cameras.values():
        weak = _uncertain_parts(camera, _WEAK_DEG, _WEAK_M)
        if weak and is_determined(camera):
            sentences.append(
                f"{camera.camera}: {_are(weak)} weakly determined ({_sigmas(camera)}): its tags are too few"
                " or too alike; add some nearer and further away, at both sides of the picture."
            )
    return sentences


def _uncertain_parts(camera: CameraPose, limit_deg: float, limit_m: float) -> list[str]:
    """Names of the angles and coordinates whose sigma is above a limit."""
    angles = [n for n, s in zip(("roll", "pitch", "yaw"), camera.sigma_deg, strict=True) if s > limit_deg]
    return angles + [n for n, s in zip(("x", "y", "z"), camera.sigma_m, strict=True) if s > limit_m]


def _are(names: list[str]) -> str:
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"


def _sigmas(camera: CameraPose) -> str:
    angle, place = camera.sigma_deg.max(), camera.sigma_m.max()
    return f"one sigma up to {angle:.2f}° and {place * 1000.0:.0f} mm"


def _blurred(result: Extrinsics) -> list[str]:
    """Cameras whose corners fit badly against the others', or by themselves."""
    found = []
    for camera, sigma in result.sigma_px.items():
        others = [px for name, px in result.sigma_px.items() if name != camera]
        usual = float(np.median(others)) if others else np.inf
        if sigma > min(max(_MISFIT * usual, _LEAST_MISFIT_PX), FAIR_PX):
            against = f", those of the other cameras by {usual:.2f}" if others else ""
            found.append(
                f"{camera}: its corners are uncertain by {sigma:.2f} px{against}: its pictures are blurred or"
                " another camera's, or its intrinsics are wrong; do not trust its sigmas, take the pictures"
                " again from a standing car, or calibrate its intrinsics anew."
            )
    return found


def _misfits(result: Extrinsics) -> list[str]:
    """Tags whose corners fit no flat square of their size, in several pictures or by being left out."""
    sigma = np.array([result.sigma_px.get(s.camera, np.nan) for s in result.sightings])
    off = np.sqrt(((result.residual_px / sigma[:, None, None]) ** 2).mean(axis=(1, 2)))
    found = []
    for tag in sorted({s.tag for s in result.sightings} - bends(result).keys() - result.own_size.keys()):
        mine = np.array([s.tag == tag for s in result.sightings])
        left_out, n, name = int((mine & ~result.used).sum()), int(mine.sum()), _named(result, tag)
        pictures = {s.picture for s, shown in zip(result.sightings, mine, strict=True) if shown}
        where = f"{left_out} of {n} pictures" if len(pictures) == n else f"{left_out} of {n} parts"
        if left_out:
            found.append(
                f"{name} does not fit in {where} and was left out there: it was moved, its id is there twice,"
                " it is bent, or something covers a corner."
            )
        elif np.sqrt(np.mean(off[mine] ** 2)) > _MISFIT:
            found.append(
                f"{name} fits no flat square of {result.network.tags[tag].size_m:g} m: its corners are off by"
                f" {np.sqrt(np.mean(off[mine] ** 2)):.1f} times the usual; it is bent, or of another size."
            )
    return found


def _bent(result: Extrinsics) -> list[str]:
    return [
        f"{_named(result, tag)} is bent by {1000.0 * bend.off_m:.1f} mm: fix it to a stiff, flat plate, and"
        " take the pictures again."
        for tag, bend in bends(result).items()
    ]


def _named(result: Extrinsics, tag: int) -> str:
    """Name of a tag at the beginning of a sentence."""
    name = result.network.tags[tag].name
    return name[0].upper() + name[1:]


def _misplaced(result: Extrinsics) -> list[str]:
    swapped = [
        f"{_named(result, first)} and {result.network.tags[second].name} are swapped: each stands where the"
        " layout has the other. Neither place was used: exchange their ids in the layout."
        for first, second in result.swapped
    ]
    slips = [
        f"{_named(result, tag)} stands {off_m:.3f} m from the place in the layout, more than"
        f" {MISPLACED_SIGMAS:g} sigmas of that measurement: it was not used; measure it again."
        for tag, off_m in result.misplaced.items()
        if tag not in result.own_size and not any(tag in pair for pair in result.swapped)
    ]
    return [*swapped, *slips]


def _sizes(result: Extrinsics) -> list[str]:
    told = []
    for tag, own in result.own_size.items():
        side_m = (1.0 + own.part) * result.network.tags[tag].size_m
        told.append(
            f"{_named(result, tag)} does not fit as stated, and fits with a black square of {side_m:.3f} m,"
            f" {100.0 * abs(own.part):.1f} ± {100.0 * own.sigma:.1f} %"
            f" {'larger' if own.part > 0.0 else 'smaller'} than the layout says: it was not used. Measure the"
            " square with a ruler; if it is as stated, measure the place again, along the line of sight."
        )
    return told


def _scale(result: Extrinsics) -> list[str]:
    if abs(result.scale) <= max(_SURE * result.scale_sigma, _LEAST_SCALE):
        return []
    sense = "larger" if result.scale > 0.0 else "smaller"
    sentence = (
        f"The tags seem {100.0 * abs(result.scale):.1f} % {sense} than the layout says: measure the black"
        " square with a ruler and correct size_m; of a board, a square."
    )
    return [sentence]


def _floor(result: Extrinsics) -> list[str]:
    found = []
    heights = [
        f"{result.network.tags[tag].name} at {1000.0 * high:+.0f} mm" for tag, high in result.bumps.items()
    ]
    if heights:
        found.append(
            f"The floor is not flat, or what is called floor does not lie on it: {', '.join(heights)}. Half a"
            " degree spoils the result: use a flat floor, or measure the heights of such tags."
        )
    if result.floor is not None and result.floor.leans:
        found.append(
            f"The floor leans by {result.floor.lean_deg:.2f}° ± {result.floor.sigma_deg:.2f}° against what"
            " the other tags say, or the measured heights are wrong; the floor was not used. Measure heights"
            " from the ground below the rear axle, find a flat floor, or measure the heights of the tags on"
            " it instead of calling them floor."
        )
    return found
