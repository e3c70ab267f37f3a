"""A sign face as filled polygons, for those who render."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

from twin.drawings.shapes import WHITE, Disc, Face, Line, Polygon, Shape, Text, regular

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

CAP_HEIGHT = 0.729
ROUND = 40
"""Corners of a circle: at 70 cm the chord lies 1 mm inside it."""


@dataclass(frozen=True, slots=True)
class Painted:
    """Rings filled at once by the even-odd rule: letters keep their holes."""

    rings: tuple[NDArray[np.float64], ...]
    """Each ``(n, 2)`` in the units of the face."""
    rgb: tuple[int, int, int]


def painted(sign: Face) -> tuple[Painted, ...]:
    """Return the plate and its shapes as polygons, in the order in which they are painted."""
    shapes = (Polygon(sign.outline, WHITE), *sign.shapes)
    return tuple(one for shape in shapes for one in _paint(shape))


def _paint(shape: Shape) -> Iterator[Painted]:
    import numpy as np

    match shape:
        case Polygon(points, colour):
            yield Painted((np.array(points),), _rgb(colour))
        case Disc(centre, radius, colour):
            yield Painted((np.array(regular(ROUND, radius, 0.0, centre)),), _rgb(colour))
        case Line(points, width, colour):
            for (x0, y0), (x1, y1) in pairwise(points):
                length = math.hypot(x1 - x0, y1 - y0) or 1.0
                dx, dy = 0.5 * width * (x1 - x0) / length, 0.5 * width * (y1 - y0) / length
                quad = ((x0 - dy, y0 + dx), (x0 + dy, y0 - dx), (x1 + dy, y1 - dx), (x1 - dy, y1 + dx))
                yield Painted((np.array(quad),), _rgb(colour))
            for point in points:
                yield Painted((np.array(regular(ROUND // 2, 0.5 * width, 0.0, point)),), _rgb(colour))
        case Text(words, (x, y), height, room, colour):
            rings, width = _letters(words)
            if width > 0.0:
                scale = min(height / CAP_HEIGHT, room / width)
                middle = np.array([0.5 * width, -0.5 * CAP_HEIGHT])
                yield Painted(
                    tuple((ring - middle) * scale + np.array([x, y]) for ring in rings), _rgb(colour)
                )


@lru_cache(maxsize=256)
def _letters(words: str) -> tuple[tuple[NDArray[np.float64], ...], float]:
    """Outlines of a text in a size of 1, from the font that matplotlib brings along; and its width."""
    import numpy as np
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    path = TextPath((0.0, 0.0), words, size=100.0, prop=FontProperties(family="DejaVu Sans", weight="bold"))
    rings = tuple(np.array(ring) * [0.01, -0.01] for ring in path.to_polygons())
    return rings, max((float(ring[:, 0].max()) for ring in rings), default=0.0)


def _rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
