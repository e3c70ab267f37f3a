"""Pictures of tags around a car to try ``calibrate extrinsics`` on, rendered with a rig that is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from geoloc.rig.rig import Rig, rig_document
from geoloc.simulation.car import simulated_rig
from geoloc.simulation.pictures.yard import TAG_M, Yard, draw_yard, turned_camera, yard_picture
from twin.calibrate.boards.pictures import Progress
from twin.calibrate.intrinsics.example import (
    TRUE_RIG,
    example_camera,
    picture_folder,
    write_picture,
)

LAYOUT, DRAWN_RIG = "layout.toml", "drawn_rig.json"
SURVEY_M = 0.001
_DRAWN_DEG, _DRAWN_M = 1.0, 0.03
"""How far a drawing is from the car that was built: one sigma of each axis."""


def write_yard(
    out: Path,
    *,
    seed: int = 0,
    floor_lean_deg: float = 0.0,
    progress: Progress = lambda _what, _done, _total: None,
) -> list[Path]:
    """Write a picture of every camera of the simulated car, the layout, the drawn and the true rig.

    Parameters
    ----------
    out : Path
        A new or an empty folder.
    seed : int
        Draws the yard, its survey (1 mm), the drawing's errors, light and noise.
    floor_lean_deg : float
        Slope of the floor, rising forward.

    Raises
    ------
    RefusedError
        If the folder holds something.
    """
    folder, rng = picture_folder(out), np.random.default_rng(seed)
    yard, rig = draw_yard(rng, sigma_m=SURVEY_M, floor_lean_deg=floor_lean_deg), example_rig()
    files = []
    for done, camera in enumerate(rig.cameras.values()):
        progress("rendering", done, len(rig.cameras))
        files.append(write_picture(folder / f"{camera.name}.png", yard_picture(yard, camera, rng)))
    progress("rendering", len(rig.cameras), len(rig.cameras))
    texts = {
        LAYOUT: layout_text(yard),
        DRAWN_RIG: _rig_text(_drawn(rig, rng)),
        TRUE_RIG: _rig_text(rig),
    }
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")
    return [*files, *(out / name for name in texts)]


def example_rig() -> Rig:
    """Return the simulated car with the cameras that the boards of ``calibrate example`` are seen by."""
    rig = simulated_rig()
    cameras = {n: replace(camera, model=example_camera(n)) for n, camera in rig.cameras.items()}
    return replace(rig, cameras=cameras)


def layout_text(yard: Yard) -> str:
    """``layout.toml`` of a yard, places to a tenth of a millimetre."""
    floor = [tag.id for tag in yard.tags.values() if tag.on_floor]
    lines = [f"size_m = {TAG_M}", f"sigma_m = {SURVEY_M}", f"floor = {floor}"]
    for tag in yard.tags.values():
        if not tag.on_floor:
            centre = ", ".join(f"{value:.4f}" for value in tag.centre_m)
            lines += ["[[tag]]", f"id = {tag.id}", f"centre = [{centre}]"]
    return "\n".join(lines) + "\n"


def _drawn(rig: Rig, rng: np.random.Generator) -> Rig:
    """The rig as a drawing has it."""
    cameras = {
        name: turned_camera(camera, rng.normal(scale=_DRAWN_DEG, size=3), rng.normal(scale=_DRAWN_M, size=3))
        for name, camera in rig.cameras.items()
    }
    return replace(rig, cameras=cameras)


def _rig_text(rig: Rig) -> str:
    return json.dumps(rig_document(rig), indent=2) + "\n"
