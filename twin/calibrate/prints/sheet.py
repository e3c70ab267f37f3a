"""A sheet of paper at true scale: millimetres from its top left corner, and rulers to check the print."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from twin.errors import ConfigError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGES_MM = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
}
"""Page sizes, upright, the smallest first."""
EDGE_MM = 8.0
"""Printers leave so much of a sheet white."""
RULER_STRIP_MM = 20.0
"""Height of what is written below, or width of the ruler beside."""
_MM_AN_INCH = 25.4
_TICK_MM, _LONG_TICK_MM = 2.0, 4.0

Box = tuple[float, float, float, float]
"""Left, top, width, height, millimetres."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """One page.

    Attributes
    ----------
    figure : matplotlib Figure
    axes : matplotlib Axes
        Over the whole page: x right, y down, in millimetres.
    width_mm, height_mm : float
    """

    figure: Figure
    axes: Axes
    width_mm: float
    height_mm: float


def new_sheet(width_mm: float, height_mm: float) -> Sheet:
    """Begin a page of this size."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_mm / _MM_AN_INCH, height_mm / _MM_AN_INCH), facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, width_mm), ylim=(height_mm, 0.0))
    axes.set_axis_off()
    return Sheet(figure, axes, width_mm, height_mm)


def page_for(width_mm: float, height_mm: float, page: str | None, what: str) -> tuple[float, float]:
    """Size of the page that holds so much, upright or lying; the smallest if none is named.

    Raises
    ------
    ConfigError
        If it does not fit, or there is no page of that name.
    """
    if page is not None and page.upper() not in PAGES_MM:
        raise ConfigError(f"There is no page {page}: name {', '.join(PAGES_MM)}.")
    fitting = [name for name, size in PAGES_MM.items() if _lain(size, width_mm, height_mm) is not None]
    wanted = page.upper() if page is not None else (fitting[0] if fitting else "A0")
    size = _lain(PAGES_MM[wanted], width_mm, height_mm)
    if size is None:
        cure = f"take {fitting[0]}, or print it smaller" if fitting else "print it smaller"
        raise ConfigError(
            f"{what} needs {width_mm:.0f} x {height_mm:.0f} mm with its margins and does not fit on "
            f"{wanted}: {cure}."
        )
    return size


def _lain(size: tuple[float, float], width_mm: float, height_mm: float) -> tuple[float, float] | None:
    for way in (size, size[::-1]):
        if width_mm <= way[0] and height_mm <= way[1]:
            return way
    return None


def print_black(sheet: Sheet, boxes: Sequence[Box]) -> None:
    """Print boxes black, as one outline: between boxes of their own, printers leave hair lines."""
    import shapely
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    whole = shapely.union_all([shapely.box(x, y, x + w, y + h) for x, y, w, h in boxes])
    parts = []
    for polygon in shapely.get_parts(whole):
        outline = shapely.orient_polygons(polygon)
        parts += [np.array(ring.coords) for ring in (outline.exterior, *outline.interiors)]
    path = Path.make_compound_path(*(Path(ring, closed=True) for ring in parts))
    sheet.axes.add_patch(PathPatch(path, facecolor="black", edgecolor="none", linewidth=0.0))


def write_text(sheet: Sheet, x_mm: float, y_mm: float, text: str, size_mm: float = 3.2) -> None:
    """Write a line, its left end at x and its middle at y, letters so high."""
    points = size_mm / _MM_AN_INCH * 72.0
    sheet.axes.text(x_mm, y_mm, text, fontsize=points, ha="left", va="center")


def draw_ruler(sheet: Sheet, x_mm: float, y_mm: float, length_mm: float, *, upright: bool = False) -> None:
    """Draw a ruler from a point to the right, or down: a centimetre a tick, numbers every five."""
    lines = [((0.0, 0.0), (length_mm, 0.0))]
    for at in np.arange(0.0, length_mm + 0.5, 10.0):
        long = round(at) % 50 == 0
        tick = _LONG_TICK_MM if long else _TICK_MM
        lines.append(((at, 0.0), (at, tick if upright else -tick)))
        if long:
            place = (at, 2.4) if not upright else (-1.2, at)
            sheet.axes.text(
                x_mm + place[0],
                y_mm + place[1],
                f"{at:.0f}" + (" mm" if at + 50.0 > length_mm else ""),
                fontsize=6.5,
                ha="center" if not upright else "right",
                va="center",
            )
    for start, end in lines:
        a, b = (point[::-1] if upright else point for point in (start, end))
        sheet.axes.plot(
            [x_mm + a[0], x_mm + b[0]],
            [y_mm + a[1], y_mm + b[1]],
            color="black",
            lw=0.5,
            solid_capstyle="butt",
        )


def ruler_length_mm(room_mm: float) -> float:
    """Longest ruler of whole five centimetres that fits, at most 20 cm."""
    return float(np.clip(50.0 * np.floor(room_mm / 50.0), 50.0, 200.0))


def pdf_pages(sheets: Sequence[Sheet]) -> bytes:
    """Write pages as one PDF, each in its own size; the same bytes at every run."""
    import matplotlib as mpl
    from matplotlib.backends.backend_pdf import PdfPages

    content = io.BytesIO()
    nothing = {"CreationDate": None, "Creator": None, "Producer": None}
    with mpl.rc_context({"pdf.fonttype": 42}), PdfPages(content, metadata=nothing) as pages:
        for sheet in sheets:
            pages.savefig(sheet.figure)
    return content.getvalue()
