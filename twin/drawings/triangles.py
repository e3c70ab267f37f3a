"""1xx, warnings, and 2xx, who gives way."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from twin.drawings import pictograms as draw
from twin.drawings.pictograms import Pictogram
from twin.drawings.shapes import (
    BLACK,
    BLUE,
    RED,
    WHITE,
    YELLOW,
    Disc,
    Face,
    Line,
    Place,
    Point,
    Polygon,
    Shape,
    Text,
    arrow,
    placed,
    rectangle,
    regular,
    rounded,
    shrunk,
)

UP_TRIANGLE = rounded(((50.0, -2.0), (102.0, 88.0), (-2.0, 88.0)), 9.0)
DOWN_TRIANGLE = rounded(((-2.0, 0.0), (102.0, 0.0), (50.0, 90.0)), 9.0)
_UP_CENTRE, _DOWN_CENTRE = (50.0, 58.0), (50.0, 30.0)
_IN_TRIANGLE: Place = (50.0, 59.0, 40.0)
_TRIANGLE_M = (0.8, 0.704)


def warning_face(number: str, _text: str) -> Face:
    """Red triangle on white; yellow ground for road works (110), as those signs are temporary."""
    base = number[:3]
    ground = YELLOW if base == "110" else WHITE
    if base in _ROADS:
        ways, width = _ROADS[base]
        drawn: tuple[Shape, ...] = tuple(Line(way, width, BLACK) for way in ways)
        if base == "100":
            drawn = arrow(_BEND, 7.0, BLACK)
        if number.endswith((".2", "V")):
            drawn = placed(placed(drawn, (-50.0, -50.0, 1.0)), (50.0, 50.0, 1.0), mirror=True)
    elif base in _WARNINGS:
        pictogram, place = _WARNINGS[base]
        drawn = placed(pictogram(BLACK, ground), place)
    else:
        drawn = (Text(number, (50.0, 64.0), 14.0, 44.0, BLACK),)
    return _triangle(drawn, ground)


def priority_face(number: str, _text: str) -> Face:
    """202 yield, 204 stop, 206 and 208 diamonds, 210 to 214."""
    drawn = _PRIORITIES.get(number[:3])
    return _triangle((Text(number, (50.0, 64.0), 14.0, 44.0, BLACK),), WHITE) if drawn is None else drawn()


def _yield() -> Face:
    inner = shrunk(DOWN_TRIANGLE, 0.66, _DOWN_CENTRE)
    return Face(*_TRIANGLE_M, DOWN_TRIANGLE, (Polygon(DOWN_TRIANGLE, RED), Polygon(inner, WHITE)))


def _stop() -> Face:
    outline = regular(8, 54.0, 22.5)
    red = shrunk(outline, 0.94, (50.0, 50.0))
    return Face(0.75, 0.75, outline, (Polygon(red, RED), Text("STOP", (50.0, 50.0), 27.0, 82.0, WHITE)))


def _crossroads() -> Face:
    cross = (
        Polygon(((44.0, 84.0), (44.0, 40.0), (50.0, 28.0), (56.0, 40.0), (56.0, 84.0)), BLACK),
        Line(((30.0, 62.0), (70.0, 62.0)), 5.0, BLACK),
    )
    return _triangle(cross, WHITE)


def _give_way_to_oncoming() -> Face:
    outline = regular(40, 50.0, 0.0)
    ring = (Disc((50.0, 50.0), 50.0, RED), Disc((50.0, 50.0), 41.0, WHITE))
    return Face(0.7, 0.7, outline, (*ring, *_meeting(RED, BLACK)))


def _oncoming_gives_way() -> Face:
    outline = rectangle(0.0, 0.0, 100.0, 100.0, 8.0)
    blue = Polygon(shrunk(outline, 0.95, (50.0, 50.0)), BLUE)
    return Face(0.7, 0.7, outline, (blue, *_meeting(WHITE, RED)))


def _triangle(drawn: tuple[Shape, ...], ground: str) -> Face:
    inner = shrunk(UP_TRIANGLE, 0.70, _UP_CENTRE)
    return Face(*_TRIANGLE_M, UP_TRIANGLE, (Polygon(UP_TRIANGLE, RED), Polygon(inner, ground), *drawn))


def _diamond(*, ended: bool) -> Face:
    outline = rounded(((50.0, -4.0), (104.0, 50.0), (50.0, 104.0), (-4.0, 50.0)), 8.0)
    shapes: tuple[Shape, ...] = (
        Polygon(outline, BLACK),
        Polygon(shrunk(outline, 0.96, (50.0, 50.0)), WHITE),
        Polygon(shrunk(outline, 0.70, (50.0, 50.0)), YELLOW),
    )
    if ended:
        shapes += tuple(
            Line(((72.0 + shift, 24.0 + shift), (24.0 + shift, 72.0 + shift)), 3.0, BLACK)
            for shift in (-5.0, -0.5, 4.0)
        )
    return Face(0.8, 0.8, outline, shapes)


def _meeting(up: str, down: str) -> tuple[Shape, ...]:
    return (
        *arrow(((64.0, 78.0), (64.0, 20.0)), 9.0, up),
        *arrow(((36.0, 24.0), (36.0, 80.0)), 9.0, down),
    )


def _lights(_ink: str, _ground: str) -> tuple[Shape, ...]:
    box = Polygon(rectangle(-0.20, -0.50, 0.20, 0.50, 0.08), BLACK)
    lamps = ((-0.30, RED), (0.0, YELLOW), (0.30, "#18a558"))
    return (box, *(Disc((0.0, y), 0.12, colour) for y, colour in lamps))


def _crossing_child(ink: str, ground: str) -> tuple[Shape, ...]:
    stripes = tuple(
        Polygon(((x, 0.36), (x + 0.12, 0.36), (x + 0.16, 0.52), (x, 0.52)), ink) for x in (-0.5, -0.16, 0.18)
    )
    return (*placed(draw.walker(ink, ground), (0.0, -0.08, 0.86)), *stripes)


def _ahead(_ink: str, _ground: str) -> tuple[Shape, ...]:
    return (*arrow(((-0.2, 0.5), (-0.2, -0.4)), 0.15, BLACK), *arrow(((0.2, -0.4), (0.2, 0.5)), 0.15, BLACK))


def _fence(ink: str, _ground: str) -> tuple[Shape, ...]:
    posts = tuple(Line(((x, -0.28), (x, 0.34)), 0.12, ink) for x in (-0.5, -0.17, 0.17, 0.5))
    return (*posts, *(Line(((-0.62, y), (0.62, y)), 0.10, ink) for y in (-0.08, 0.2)))


def _slope(ink: str, _ground: str) -> tuple[Shape, ...]:
    return Polygon(((-0.75, -0.1), (0.75, 0.5), (-0.75, 0.5)), ink), Text(
        "8 %", (0.22, -0.12), 0.34, 0.9, ink
    )


def _rocks(ink: str, _ground: str) -> tuple[Shape, ...]:
    rocks = (((0.05, -0.05), 0.10), ((0.30, 0.18), 0.13), ((0.02, 0.24), 0.09), ((0.55, 0.42), 0.10))
    cliff = Polygon(((-0.55, 0.5), (-0.48, -0.45), (-0.30, -0.40), (-0.18, 0.5)), ink)
    return (cliff, *(Disc(centre, radius, ink) for centre, radius in rocks))


def _tunnel(ink: str, ground: str) -> tuple[Shape, ...]:
    mouth = (
        *((x, y) for x, y in regular(24, 0.42, 180.0, (0.0, 0.0)) if y <= 0.01),
        (0.42, 0.45),
        (-0.42, 0.45),
    )
    road = ((-0.10, 0.45), (0.10, 0.45), (0.03, -0.05), (-0.03, -0.05))
    return Polygon(mouth, ink), Polygon(road, ground)


def _queue(ink: str, ground: str) -> tuple[Shape, ...]:
    return tuple(
        shape
        for y, size in ((-0.34, 0.36), (0.02, 0.42), (0.40, 0.5))
        for shape in placed(draw.car(ink, ground), (0.0, y, size))
    )


_BEND: tuple[Point, ...] = ((44.0, 82.0), (44.0, 62.0), (48.0, 54.0), (62.0, 44.0))
_ROADS: dict[str, tuple[tuple[tuple[Point, ...], ...], float]] = {
    "100": ((_BEND,), 7.0),
    "102": ((((46.0, 82.0), (46.0, 70.0), (56.0, 58.0), (46.0, 46.0), (50.0, 34.0)),), 7.0),
    "106": (
        (
            ((36.0, 82.0), (36.0, 66.0), (44.0, 54.0), (44.0, 40.0)),
            ((64.0, 82.0), (64.0, 66.0), (56.0, 54.0), (56.0, 40.0)),
        ),
        5.0,
    ),
    "124": ((((34.0, 80.0), (66.0, 48.0)), ((34.0, 48.0), (66.0, 80.0))), 9.0),
}
_WIDE: Place = (50.0, 62.0, 30.0)
_WARNINGS: dict[str, tuple[Pictogram, Place]] = {
    "104": (_slope, _WIDE),
    "108": (draw.bumps, (50.0, 62.0, 46.0)),
    "109": (draw.hump, (50.0, 62.0, 46.0)),
    "110": (draw.digger, (54.0, 62.0, 38.0)),
    "114": (_rocks, _IN_TRIANGLE),
    "116": (draw.skid, (50.0, 58.0, 44.0)),
    "122": (_tunnel, (50.0, 62.0, 40.0)),
    "126": (draw.roundabout, (50.0, 62.0, 40.0)),
    "132": (_lights, (50.0, 58.0, 46.0)),
    "134": (_fence, (50.0, 64.0, 34.0)),
    "140": (_crossing_child, _IN_TRIANGLE),
    "142": (draw.children, (50.0, 60.0, 42.0)),
    "144": (draw.bicycle, (50.0, 66.0, 36.0)),
    "146": (draw.moose, (50.0, 62.0, 38.0)),
    "148": (_ahead, (50.0, 62.0, 34.0)),
    "149": (_queue, (50.0, 58.0, 50.0)),
    "156": (draw.exclamation, (50.0, 56.0, 50.0)),
}
_PRIORITIES: dict[str, Callable[[], Face]] = {
    "202": _yield,
    "204": _stop,
    "206": partial(_diamond, ended=False),
    "208": partial(_diamond, ended=True),
    "210": _crossroads,
    "212": _give_way_to_oncoming,
    "214": _oncoming_gives_way,
}
