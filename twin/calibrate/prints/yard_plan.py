"""The plan of a yard: a drawing, a table to fill in, the tags to print, and a ``layout.toml`` to complete."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from geoloc.rig.rig import Rig
from twin.calibrate.extrinsics.given_rig import read_given_rig
from twin.calibrate.prints.sheet import PAGES_MM, Sheet, new_sheet, pdf_pages, write_text
from twin.calibrate.prints.tags import tags_pdf
from twin.calibrate.prints.yard_places import PlannedTag, planned_tags
from twin.errors import RefusedError
from twin.store.atomic_files import replacing
from twin.store.folders import make_folder

PLAN_NAME, TAGS_NAME, LAYOUT_NAME = "plan.pdf", "tags.pdf", "layout.toml"
_ROWS_A_PAGE = 24
_ROW_MM = 6.2
_LEFT_MM, _TOP_MM = 15.0, 14.0
_COLUMNS = (
    ("tag", 0.0),
    ("x forward", 14.0),
    ("y left", 36.0),
    ("middle, height", 54.0),
    ("from the rear axle", 82.0),
    ("seen by", 114.0),
    ("measured: x", 182.0),
    ("y", 217.0),
    ("z", 247.0),
)
_LINES = (182.0, 217.0, 247.0, 270.0)
_SIGHT_M = 7.0
_COLOURS = ("#1f6f8b", "#c8553d", "#6a994e", "#7b4b94", "#b08900", "#3d405b", "#0a9396", "#9b2226")


def write_yard_plan(rig: Path, out: Path, size_m: float, page: str | None = None) -> tuple[list[Path], int]:
    """Write the plan of a yard for a rig.

    Parameters
    ----------
    rig : Path
        As `read_given_rig` takes it; its cameras' rough places and angles must be known.
    out : Path
        Folder for ``plan.pdf``, ``tags.pdf`` and ``layout.toml``.
    size_m : float
        Edge of the tags' black squares.
    page : str, optional
        Of the tags: A4 to A0.

    Returns
    -------
    files, n_tags : list of Path, int

    Raises
    ------
    CalibrationError, ConfigError, FileError, DriveError, RefusedError
        If the rig cannot be read or has no camera with a place, the tags do not fit their page, or the folder
        cannot be written.
    """
    given = read_given_rig(rig).rig
    tags = planned_tags(given, size_m)
    files = {
        PLAN_NAME: pdf_pages([_drawing(given, tags, size_m), *_tables(tags, size_m)]),
        TAGS_NAME: tags_pdf([tag.id for tag in tags], size_m, page),
        LAYOUT_NAME: layout_text(tags, size_m).encode(),
    }
    folder = make_folder(out)
    if (folder / LAYOUT_NAME).exists():
        raise RefusedError(
            f"{folder / LAYOUT_NAME} is there already, and may hold what somebody measured: name another"
            " folder by --out, or move it away."
        )
    with replacing(folder, list(files)) as staging:
        for name, content in files.items():
            (staging / name).write_bytes(content)
    return [folder / name for name in files], len(tags)


def layout_text(tags: Sequence[PlannedTag], size_m: float) -> str:
    """``layout.toml`` to complete: tags that nobody measured still tie the cameras together."""
    floor = [tag.id for tag in tags if tag.on_floor]
    lines = [
        f"size_m = {size_m:g}             # measure the prints: edge of the black square",
        "sigma_m = 0.003           # of measured places: 1 mm for a total station, 3 to 5 mm for a tape",
        f"floor = {floor}",
    ]
    for tag in tags:
        if not tag.on_floor:
            planned = ", ".join(f"{part:.2f}" for part in tag.place_m)
            lines += [
                "[[tag]]",
                f"id = {tag.id}",
                f"# centre = [{planned}]   # planned: write what was measured and take the # away",
            ]
    return "\n".join(lines) + "\n"


def _drawing(rig: Rig, tags: Sequence[PlannedTag], size_m: float) -> Sheet:
    sheet = new_sheet(*PAGES_MM["A4"][::-1])
    write_text(sheet, _LEFT_MM, _TOP_MM, f"Yard for {rig.source}: {len(tags)} tags of {size_m:g} m", 4.5)
    axes = sheet.figure.add_axes((0.07, 0.09, 0.9, 0.8))
    placed = [camera for camera in rig.cameras.values() if camera.is_placed]
    for colour, camera in zip(_cycled(len(placed)), placed, strict=True):
        eye = camera.rig_t_camera_m
        axes.plot(eye[0], eye[1], "o", color=colour, ms=5, label=camera.name)
        middle = 0.5 * camera.model.height_px
        edges = np.array([[0.0, middle], [camera.model.width_px - 1.0, middle]])
        rays, inside = camera.model.camera_ray_from_pixel(edges)
        for ray in (rays @ camera.rig_R_camera.T)[inside]:
            axes.plot(*zip(eye[:2], eye[:2] + _SIGHT_M * ray[:2], strict=True), color=colour, lw=0.7, ls=":")
    for tag in tags:
        x, y, _ = tag.place_m
        axes.plot(x, y, "s", ms=7, mfc="white" if tag.on_floor else "#333333", mec="#333333")
        axes.annotate(str(tag.id), (x, y), fontsize=8, xytext=(6, 4), textcoords="offset points")
    axes.plot(0.0, 0.0, "+", color="black", ms=12)
    axes.plot([], [], "s", mfc="#333333", mec="#333333", label="stands")
    axes.plot([], [], "s", mfc="white", mec="#333333", label="on the floor")
    axes.plot([], [], "+", color="black", label="rear axle, middle")
    axes.set(xlabel="x forward [m]", ylabel="y left [m]", aspect="equal")
    axes.grid(color="#dddddd")
    axes.margins(0.08)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=8, frameon=False)
    return sheet


def _tables(tags: Sequence[PlannedTag], size_m: float) -> list[Sheet]:
    sheets = []
    for start in range(0, len(tags), _ROWS_A_PAGE):
        sheet = new_sheet(*PAGES_MM["A4"][::-1])
        write_text(
            sheet,
            _LEFT_MM,
            _TOP_MM,
            f"Tags of {size_m:g} m, 36h11. Metres from the ground below the middle of the rear axle. Stand "
            "each within 20 cm of its place, upright, facing the car;",
        )
        more = "then measure its middle to millimetres and write it here and into layout.toml."
        write_text(sheet, _LEFT_MM, _TOP_MM + 5.0, more)
        _table(sheet, tags[start : start + _ROWS_A_PAGE], _TOP_MM + 14.0)
        sheets.append(sheet)
    return sheets


def _table(sheet: Sheet, tags: Sequence[PlannedTag], top_mm: float) -> None:
    for title, at in _COLUMNS:
        write_text(sheet, _LEFT_MM + at, top_mm, title, 2.8)
    for row, tag in enumerate(tags, 1):
        x, y, z = tag.place_m
        height = "floor" if tag.on_floor else f"{z:.2f}"
        # Cameras' names are long: a table has room for some.
        seen = ", ".join(tag.cameras)
        cells = (str(tag.id), f"{x:.1f}", f"{y:.1f}", height, f"{np.hypot(x, y):.1f}", seen)
        for text, (_, at) in zip(cells, _COLUMNS, strict=False):
            fitting = text if len(text) <= 46 else f"{text[:45]}…"
            write_text(sheet, _LEFT_MM + at, top_mm + row * _ROW_MM, fitting, 2.6)
    bottom = top_mm + (len(tags) + 0.5) * _ROW_MM
    for line in range(len(tags) + 1):
        y_mm = top_mm + (line + 0.5) * _ROW_MM
        sheet.axes.plot([_LEFT_MM, _LEFT_MM + _LINES[-1]], [y_mm, y_mm], color="#999999", lw=0.3)
    for at in _LINES:
        x_mm = _LEFT_MM + at - 2.0 * (at < _LINES[-1])
        sheet.axes.plot([x_mm, x_mm], [top_mm + 0.5 * _ROW_MM, bottom], color="#999999", lw=0.3)


def _cycled(n: int) -> list[str]:
    return [_COLOURS[i % len(_COLOURS)] for i in range(n)]
