"""Labels beside points, where there is room."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.transforms import Bbox
    from numpy.typing import NDArray

SAME_PLACE_M = 0.5
"""Plates of one pole share a label, one line a plate."""
_SIDES = ((1, 0), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1), (0, 1), (0, -1))
_DISTANCES_PT = (8.0, 16.0, 26.0)


def place_labels(axes: Axes, xy: NDArray[np.float64], texts: Sequence[str], *, size_pt: float = 8.0) -> int:
    """Write texts beside points, without covering each other or a point where that can be helped.

    Parameters
    ----------
    axes : Axes
        With its limits set, on a figure with an Agg canvas.
    xy : float64 (n, 2)
        Data coordinates.
    texts : sequence of str
        n texts; "" is left out.
    size_pt : float

    Returns
    -------
    int
        How many labels cover something.
    """
    from matplotlib.transforms import Bbox

    dots = axes.transData.transform(xy) if len(xy) else np.empty((0, 2))
    taken = [Bbox.from_bounds(x - 6, y - 6, 12, 12) for x, y in dots]
    crowded = 0
    for point, text in _by_place(xy, texts):
        free = _write(axes, point, text, taken, size_pt)
        crowded += not free
    return crowded


def _by_place(xy: NDArray[np.float64], texts: Sequence[str]) -> list[tuple[NDArray[np.float64], str]]:
    groups: dict[tuple[float, ...], tuple[NDArray[np.float64], list[str]]] = {}
    for point, text in zip(xy, texts, strict=True):
        lines = groups.setdefault(tuple(np.round(point / SAME_PLACE_M)), (point, []))[1]
        if text and text not in lines:
            lines.append(text)
    return [(point, "\n".join(lines)) for point, lines in groups.values() if lines]


def _write(axes: Axes, point: NDArray[np.float64], text: str, taken: list[Bbox], size_pt: float) -> bool:
    """Write one label at the first free place (else the first place), and take that place."""
    from matplotlib.patheffects import withStroke

    label = axes.annotate(
        text,
        tuple(point),
        (0, 0),
        textcoords="offset points",
        fontsize=size_pt,
        color="#222222",
        zorder=10,
        path_effects=[withStroke(linewidth=2.5, foreground="white")],
    )
    inside = axes.get_window_extent()
    places = [(distance * x, distance * y) for distance in _DISTANCES_PT for x, y in _SIDES]
    for x, y in [*places, places[0]]:
        label.set_position((x, y))
        label.set_horizontalalignment("left" if x > 0 else "right" if x < 0 else "center")
        label.set_verticalalignment("bottom" if y > 0 else "top" if y < 0 else "center")
        box = label.get_window_extent()
        within = inside.x0 <= box.x0 and box.x1 <= inside.x1 and inside.y0 <= box.y0 and box.y1 <= inside.y1
        if within and not any(box.overlaps(other) for other in taken):
            taken.append(box)
            return True
    taken.append(label.get_window_extent())
    return False
