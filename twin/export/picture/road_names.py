"""Names of roads on a map: along the drive where its signs stand, else beside the signs."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from twin.export.layers import ExportLayers
from twin.export.picture.map_frame import Window, east_north

if TYPE_CHECKING:
    from collections.abc import Sequence

    import shapely
    from matplotlib.axes import Axes
    from matplotlib.patheffects import AbstractPathEffect
    from matplotlib.text import Text
    from numpy.typing import NDArray

_BESIDE_M = 15.0
"""A sign within this distance of the driven line belongs to the road that was driven."""
_STEP_M = 5.0
"""Half of the stretch of the line that a name is turned like."""
_LOOK: dict[str, Any] = {
    "fontsize": 8.5,
    "style": "italic",
    "color": "#3d4a57",
    "ha": "center",
    "zorder": 2.5,
}


def draw_road_names(axes: Axes, window: Window, layers: ExportLayers) -> int:
    """Write the name of each road that has signs in the window, the roads with most signs first.

    The name is the vegnummer of the signs' vegsystemreferanse, and the street where NVDB has told it. One
    that would cover another is left out.

    Returns
    -------
    int
        How many names were written.
    """
    import shapely
    from matplotlib.transforms import Bbox

    places = _places_by_road(window, layers)
    streets = _streets(layers)
    drives = [line for line in layers.drives.geometry if line is not None]
    lines = list(shapely.get_parts(shapely.line_merge(shapely.union_all(drives))))
    marks = np.concatenate([east_north(layers.changes), *(np.array(points) for points in places.values())])
    # The corner of the arrow to the north.
    taken = [axes.transAxes.transform_bbox(Bbox([[0.92, 0.0], [1.0, 0.16]]))]
    for road, points in sorted(places.items(), key=lambda one: (-len(one[1]), one[0])):
        text = f"{road} {streets.get(road, '')}".strip()
        place = _gap(np.array(points), marks, lines)
        name = _beside(axes, text, np.array(points)) if place is None else _along(axes, text, *place)
        box = name.get_window_extent()
        inside = axes.bbox.contains(*box.min) and axes.bbox.contains(*box.max)
        if inside and not any(box.overlaps(other) for other in taken):
            taken.append(box)
        else:
            name.remove()
    return len(taken) - 1


def _places_by_road(window: Window, layers: ExportLayers) -> dict[str, list[NDArray[np.float64]]]:
    """Road → where its signs stand in the window."""
    signs = layers.nvdb_signs[layers.nvdb_signs.geometry.notna()]
    places: dict[str, list[NDArray[np.float64]]] = {}
    for reference, point in zip(signs["road_reference"], east_north(signs), strict=True):
        inside = np.abs(point - [window.east_m, window.north_m]) < [window.half_width_m, window.half_height_m]
        if reference and inside.all():
            places.setdefault(str(reference).split(" ", maxsplit=1)[0], []).append(point)
    return places


def _streets(layers: ExportLayers) -> dict[str, str]:
    """Road → the street that most of the findings on it name."""
    named: dict[str, Counter[str]] = {}
    for text in layers.changes["road"]:
        reference, _, street = str(text).partition(", ")
        if street:
            named.setdefault(reference.split(" ", maxsplit=1)[0], Counter())[street] += 1
    return {road: streets.most_common(1)[0][0] for road, streets in named.items()}


def _beside(axes: Axes, text: str, points: NDArray[np.float64]) -> Text:
    """Write a name above the northernmost sign of its road."""
    above = points[np.argmax(points[:, 1])]
    return axes.annotate(
        text, above, (0, 9), textcoords="offset points", va="bottom", path_effects=_halo(), **_LOOK
    )


def _along(axes: Axes, text: str, place: tuple[float, float], turn_deg: float) -> Text:
    """Write a name on a line, turned like it."""
    return axes.text(
        *place,
        text,
        rotation=turn_deg,
        rotation_mode="anchor",
        va="center",
        path_effects=_halo(),
        **_LOOK,
    )


def _halo() -> list[AbstractPathEffect]:
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=3.5, foreground="white")]


def _gap(
    points: NDArray[np.float64], marks: NDArray[np.float64], lines: Sequence[shapely.LineString]
) -> tuple[tuple[float, float], float] | None:
    """Middle of the longest stretch of a line, between signs of a road, that no mark stands at.

    In degrees counter-clockwise from east the line's direction there, so that letters stand upright. None
    where no line runs past two signs of the road.
    """
    best: tuple[float, shapely.LineString, float] | None = None
    for line in lines:
        own = _stations(line, points)
        if own.size < 2:
            continue
        stations = _stations(line, marks)
        stations = stations[(stations >= own[0]) & (stations <= own[-1])]
        widest = int(np.argmax(np.diff(stations)))
        length = float(np.diff(stations)[widest])
        if best is None or length > best[0]:
            best = length, line, float(stations[widest : widest + 2].mean())
    if best is None:
        return None
    _, line, at = best
    before, here, after = (line.interpolate(at + d) for d in (-_STEP_M, 0.0, _STEP_M))
    turn_deg = float(np.degrees(np.arctan2(after.y - before.y, after.x - before.x)))
    return (here.x, here.y), (turn_deg + 90.0) % 180.0 - 90.0


def _stations(line: shapely.LineString, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far along a line the points beside it stand, in order."""
    import shapely

    geometry: NDArray[np.object_] = np.asarray(shapely.points(points), dtype=object)
    near = geometry[shapely.distance(line, geometry) <= _BESIDE_M]
    return np.sort(np.asarray(shapely.line_locate_point(line, near), dtype=np.float64))
