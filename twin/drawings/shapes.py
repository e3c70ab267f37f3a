"""What a sign face is made of, in units of a hundredth of its width: x to the right, y down."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

Point = tuple[float, float]
Place = tuple[float, float, float]
"""Where a pictogram goes: its centre x and y, and its height."""

WHITE, BLACK, RED, BLUE, YELLOW = "#ffffff", "#15171a", "#cf1020", "#0b4ea2", "#ffcf00"
GREY = "#9aa0a6"


@dataclass(frozen=True, slots=True)
class Polygon:
    """A filled polygon."""

    points: tuple[Point, ...]
    colour: str


@dataclass(frozen=True, slots=True)
class Disc:
    """A filled circle."""

    centre: Point
    radius: float
    colour: str


@dataclass(frozen=True, slots=True)
class Line:
    """A broken line with round ends and joints."""

    points: tuple[Point, ...]
    width: float
    colour: str


@dataclass(frozen=True, slots=True)
class Text:
    """One line of bold text around its centre, made narrower than `height` says where it has no room."""

    words: str
    centre: Point
    height: float
    """Of the capitals."""
    room: float
    """Width that it may take."""
    colour: str


Shape = Polygon | Disc | Line | Text


@dataclass(frozen=True, slots=True)
class Face:
    """One sign.

    Attributes
    ----------
    width_m, height_m : float
        Of the plate. Usual sizes on a street; NVDB's own property may say otherwise.
    outline : tuple of points
        The plate's edge. 100 units are `width_m`, in both directions.
    shapes : tuple of Shape
        Painted in this order.
    """

    width_m: float
    height_m: float
    outline: tuple[Point, ...]
    shapes: tuple[Shape, ...]

    @property
    def height(self) -> float:
        """Height in units."""
        return 100.0 * self.height_m / self.width_m


def rectangle(left: float, top: float, right: float, bottom: float, corner: float = 0.0) -> tuple[Point, ...]:
    """Corners of a rectangle, cut round by `corner`."""
    if corner == 0.0:
        return (left, top), (right, top), (right, bottom), (left, bottom)
    points = []
    turns = ((right, top, -90), (right, bottom, 0), (left, bottom, 90), (left, top, 180))
    for x, y, start in turns:
        cx = x - corner if x == right else x + corner
        cy = y - corner if y == bottom else y + corner
        for step in range(5):
            angle = math.radians(start + 22.5 * step)
            points.append((cx + corner * math.cos(angle), cy + corner * math.sin(angle)))
    return tuple(points)


def regular(sides: int, radius: float, start_deg: float, centre: Point = (50.0, 50.0)) -> tuple[Point, ...]:
    """Corners of a regular polygon; `start_deg` clockwise from the right."""
    angles = (math.radians(start_deg + 360.0 * i / sides) for i in range(sides))
    return tuple((centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a)) for a in angles)


def rounded(corners: Sequence[Point], corner: float) -> tuple[Point, ...]:
    """Cut the corners of a convex polygon round, beginning `corner` before each."""
    points = []
    for i, (x, y) in enumerate(corners):
        before, after = corners[i - 1], corners[(i + 1) % len(corners)]
        start, end = _towards((x, y), before, corner), _towards((x, y), after, corner)
        for t in (0.0, 0.25, 0.5, 0.75, 1.0):
            a, b, c = (1 - t) ** 2, 2 * t * (1 - t), t**2
            points.append((a * start[0] + b * x + c * end[0], a * start[1] + b * y + c * end[1]))
    return tuple(points)


def shrunk(points: Sequence[Point], factor: float, centre: Point) -> tuple[Point, ...]:
    """Points drawn together about a centre."""
    return tuple(
        (centre[0] + factor * (x - centre[0]), centre[1] + factor * (y - centre[1])) for x, y in points
    )


def arrow(way: Sequence[Point], width: float, colour: str, *, head: float = 2.6) -> tuple[Shape, ...]:
    """A broken line that ends in an arrow head `head` widths broad."""
    (x0, y0), (x1, y1) = way[-2], way[-1]
    length = math.hypot(x1 - x0, y1 - y0)
    dx, dy = (x1 - x0) / length, (y1 - y0) / length
    broad, long = head * width / 2.0, head * width * 0.75
    base = (x1 - dx * long, y1 - dy * long)
    tip = (
        (x1, y1),
        (base[0] - dy * broad, base[1] + dx * broad),
        (base[0] + dy * broad, base[1] - dx * broad),
    )
    return Line((*way[:-1], (base[0] + dx * 0.3 * long, base[1] + dy * 0.3 * long)), width, colour), Polygon(
        tip, colour
    )


def arc(centre: Point, radius: float, start_deg: float, end_deg: float, steps: int = 14) -> tuple[Point, ...]:
    """Points of an arc; degrees clockwise from the right."""
    angles = (math.radians(start_deg + (end_deg - start_deg) * i / steps) for i in range(steps + 1))
    return tuple((centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a)) for a in angles)


def placed(shapes: Iterable[Shape], place: Place, *, mirror: bool = False) -> tuple[Shape, ...]:
    """Move shapes drawn in a box of height 1 around (0, 0) to where they go."""
    cx, cy, size = place
    sign = -1.0 if mirror else 1.0

    def move(point: Point) -> Point:
        return cx + sign * size * point[0], cy + size * point[1]

    moved: list[Shape] = []
    for shape in shapes:
        match shape:
            case Polygon(points, colour):
                moved.append(Polygon(tuple(map(move, points)), colour))
            case Disc(centre, radius, colour):
                moved.append(Disc(move(centre), radius * size, colour))
            case Line(points, width, colour):
                moved.append(Line(tuple(map(move, points)), width * size, colour))
            case Text(words, centre, height, room, colour):
                moved.append(Text(words, move(centre), height * size, room * size, colour))
    return tuple(moved)


def _towards(start: Point, end: Point, distance: float) -> Point:
    length = math.hypot(end[0] - start[0], end[1] - start[1])
    t = min(distance / length, 0.5)
    return start[0] + t * (end[0] - start[0]), start[1] + t * (end[1] - start[1])
