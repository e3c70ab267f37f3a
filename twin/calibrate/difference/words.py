"""What two calibrations say of each other, in a sentence a camera."""

from __future__ import annotations

from twin.calibrate.difference.compare import (
    SIGN_M,
    CameraCompared,
    FitVerdict,
    LensCompared,
    MountingCompared,
)

_SURE = 1e-5


def verdict_sentence(compared: CameraCompared) -> str:
    """Say whether two fits of a camera agree, how far they part, and where in the picture."""
    parts = [_lens(compared.lens)]
    if compared.mounting is not None:
        parts.append(_mounting(compared.mounting))
    return f"{compared.camera}: {'; '.join(parts)}."


def metres(value: float) -> str:
    """Write a small length so that two figures of it show: ``0.7 mm``, ``3.1 cm``, ``0.42 m``."""
    for limit, factor, unit in ((0.01, 1000.0, "mm"), (0.1, 100.0, "cm")):
        if abs(value) < limit:
            return f"{factor * value:.1f} {unit}"
    return f"{value:.2f} m"


def _lens(lens: LensCompared) -> str:
    most = f"{lens.largest_deg:.4f}° ({lens.largest_px:.3f} px, {_place(lens.where)})"
    sign = _sign(lens.sideways_m, lens.along_m)
    if lens.verdict is FitVerdict.SAME:
        return "the lens is the same in both"
    if lens.verdict is FitVerdict.NOT_JUDGED:
        return f"the lenses part by {most} at most = {sign}"
    sigmas = f"{lens.in_sigmas:.1f} times what their uncertainty gives by chance"
    if lens.verdict is FitVerdict.AGREE:
        return f"the lenses agree: they part by {most} at most = {sign}, {sigmas}"
    return f"the lenses differ by {most} = {sign}, {sigmas} ({_chance(lens.by_chance)})"


def _mounting(mounting: MountingCompared) -> str:
    turn = sum(angle**2 for angle in mounting.roll_pitch_yaw_deg) ** 0.5
    moved = sum(part**2 for part in mounting.moved_m) ** 0.5
    how = f"turned by {turn:.3f}° and moved by {metres(moved)}"
    sign = f"together {_sign(mounting.sideways_m, mounting.along_m)}"
    if mounting.verdict is FitVerdict.NOT_JUDGED:
        return f"the mounting is {how}, {sign}"
    if mounting.verdict is FitVerdict.AGREE:
        return f"the mountings agree: {how}, which is chance, {sign}"
    return f"the mountings differ: {how}, {sign} ({_chance(mounting.by_chance)})"


def _sign(sideways_m: float, along_m: float) -> str:
    return f"{metres(sideways_m)} sideways and {metres(along_m)} along at {SIGN_M:g} m"


def _place(where: str) -> str:
    return "in the middle" if where == "middle" else f"at the {where}"


def _chance(by_chance: float | None) -> str:
    if by_chance is None or by_chance < _SURE:
        return f"chance makes that in fewer than 1 of {1.0 / _SURE:,.0f} pairs"
    return f"chance makes that in {by_chance:.1%} of pairs"
