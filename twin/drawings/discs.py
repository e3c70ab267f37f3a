"""3xx, what is forbidden, and 4xx, what one must."""

from __future__ import annotations

from twin.drawings import pictograms as draw
from twin.drawings.pictograms import Pictogram
from twin.drawings.shapes import (
    BLACK,
    BLUE,
    GREY,
    RED,
    WHITE,
    Disc,
    Face,
    Line,
    Place,
    Point,
    Polygon,
    Shape,
    Text,
    arc,
    arrow,
    placed,
    rectangle,
    regular,
    shrunk,
)

CENTRE = (50.0, 50.0)
CIRCLE = regular(48, 50.0, 0.0)
DISC_M = 0.7
RING = 39.0
"""Radius of the white inside a red ring."""


def prohibition_face(number: str, text: str) -> Face:
    """Red rings, the blue ones of parking, grey ends, and the zones on square plates."""
    base, _, variant = number.partition(".")
    if base in {"366", "368"}:
        return _zone(text.partition(" ")[0] or "30", ended=base == "368")
    if base in {"376", "377", "378", "379"}:
        return _parking_zone(crossed=base in {"377", "379"}, ended=base in {"378", "379"})
    return _disc(*_on_disc(base, variant, text), *(_forbidden(base, variant, number)))


def _on_disc(base: str, variant: str, text: str) -> tuple[Shape, ...]:
    """Return the ground, and what is written on it."""
    limit = variant or text or "50"
    match base:
        case "302":
            return Disc(CENTRE, 48.0, RED), Polygon(rectangle(14.0, 41.0, 86.0, 59.0), WHITE)
        case "336" | "337":
            shapes: tuple[Shape, ...] = (Disc(CENTRE, 49.0, BLACK), Disc(CENTRE, 47.5, WHITE))
            return (*shapes, *_cars(GREY, GREY), *_ends())
        case "362":
            return (*_ring(), Text(limit, CENTRE, 36.0, 62.0, BLACK))
        case "364":
            return _ended(limit)
        case "370" | "372":
            return _parking(crossed=base == "370")
    return (*_ring(), *_LIMITS[base], *_limit_text(base, text)) if base in _LIMITS else _ring()


def mandatory_face(number: str, _text: str) -> Face:
    """White on a blue disc."""
    base, _, variant = number.partition(".")
    blue = Disc(CENTRE, 48.0, BLUE)
    if base == "406":
        return _disc(blue, *placed(draw.roundabout(WHITE, BLUE), (50.0, 50.0, 78.0)))
    if base == "404":
        left = variant.startswith("2")
        return _disc(
            blue, *arrow(((72.0, 26.0), (28.0, 74.0)) if left else ((28.0, 26.0), (72.0, 74.0)), 13.0, WHITE)
        )
    if base == "402":
        ways = _MANDATORY.get(variant, _MANDATORY["1"])
        return _disc(blue, *(shape for way in ways for shape in arrow(way, 12.0, WHITE)))
    return _disc(blue, Text(number, CENTRE, 26.0, 76.0, WHITE))


def _disc(*shapes: Shape) -> Face:
    return Face(DISC_M, DISC_M, CIRCLE, shapes)


def _ring() -> tuple[Shape, ...]:
    return Disc(CENTRE, 49.0, RED), Disc(CENTRE, RING, WHITE)


def _bar(colour: str, width: float = 8.0) -> Shape:
    """From the upper left to the lower right, as on 332 and 372."""
    return Line(((22.0, 22.0), (78.0, 78.0)), width, colour)


def _ends() -> tuple[Shape, ...]:
    return tuple(Line(((75.0 + d, 19.0 + d), (19.0 + d, 75.0 + d)), 2.6, BLACK) for d in (-1.0, 3.0, 7.0))


def _ended(number: str) -> tuple[Shape, ...]:
    return (
        Disc(CENTRE, 49.0, BLACK),
        Disc(CENTRE, 47.5, WHITE),
        Text(number, CENTRE, 36.0, 62.0, GREY),
        *_ends(),
    )


def _parking(*, crossed: bool) -> tuple[Shape, ...]:
    bars = (_bar(RED), Line(((78.0, 22.0), (22.0, 78.0)), 8.0, RED)) if crossed else (_bar(RED),)
    return Disc(CENTRE, 49.0, RED), Disc(CENTRE, 40.0, BLUE), *bars


def _zone(number: str, *, ended: bool) -> Face:
    """Red ring with a number over the word SONE."""
    ring, ink = (GREY, GREY) if ended else (RED, BLACK)
    shapes: tuple[Shape, ...] = (
        Disc((50.0, 44.0), 36.0, ring),
        Disc((50.0, 44.0), 28.0, WHITE),
        Text(number, (50.0, 44.0), 26.0, 44.0, ink),
        Text("SONE", (50.0, 101.0), 20.0, 80.0, ink),
    )
    if ended:
        shapes += tuple(
            Line(((88.0 + d, 14.0 + d), (14.0 + d, 100.0 + d)), 2.6, BLACK) for d in (-2.0, 2.0, 6.0)
        )
    return _plate(shapes)


def _parking_zone(*, crossed: bool, ended: bool) -> Face:
    disc = placed(placed(_parking(crossed=crossed), (-50.0, -50.0, 1.0)), (50.0, 44.0, 0.74))
    shapes: tuple[Shape, ...] = (*disc, Text("SONE", (50.0, 101.0), 20.0, 80.0, GREY if ended else BLACK))
    if ended:
        shapes += (Line(((88.0, 14.0), (14.0, 106.0)), 4.0, BLACK),)
    return _plate(shapes)


def _plate(shapes: tuple[Shape, ...]) -> Face:
    """A white square-cornered plate of 60 × 72 cm with a black edge."""
    outline = rectangle(0.0, 0.0, 100.0, 120.0, 7.0)
    edge = shrunk(outline, 0.96, (50.0, 60.0))
    inner = shrunk(outline, 0.93, (50.0, 60.0))
    return Face(0.6, 0.72, outline, (Polygon(edge, BLACK), Polygon(inner, WHITE), *shapes))


def _cars(left: str, right: str) -> tuple[Shape, ...]:
    return *placed(draw.car(left, WHITE), (34.0, 50.0, 34.0)), *placed(
        draw.car(right, WHITE), (66.0, 50.0, 34.0)
    )


def _forbidden(base: str, variant: str, number: str) -> tuple[Shape, ...]:
    """Return what stands in the red ring; the number itself where we have no drawing."""
    shapes: tuple[Shape, ...] = (Text(number, CENTRE, 22.0, 66.0, BLACK),)
    if base in _ON_GROUND or number in {"306", "306.0"}:
        shapes = ()
    elif base == "334":
        shapes = _cars(RED, BLACK)
    elif base == "335":
        lorry = placed(draw.lorry(RED, WHITE), (34.0, 50.0, 26.0))
        shapes = (*lorry, *placed(draw.car(BLACK, WHITE), (69.0, 50.0, 32.0)))
    elif base == "332":
        way = (*arc((50.0, 42.0), 13.0, 0.0, -180.0), (37.0, 72.0))
        shapes = (*arrow(((63.0, 72.0), *way), 8.0, BLACK), _bar(RED, 7.0))
    elif base == "330":
        out = 34.0 if variant == "2" else 66.0
        shapes = (*arrow(((100.0 - out, 74.0), (100.0 - out, 48.0), (out, 48.0)), 8.0, BLACK), _bar(RED, 7.0))
    elif base == "306" and variant in _VEHICLES:
        pictogram, place = _VEHICLES[variant]
        shapes = placed(pictogram(BLACK, WHITE), place)
    elif base == "326":
        shapes = (Text("STOP", CENTRE, 20.0, 64.0, BLACK),)
    return shapes


def _limit_text(base: str, text: str) -> tuple[Shape, ...]:
    word = text.partition(" ")[0] or {"312": "2,2m"}.get(base, "")
    words = word or {"314": "10 m", "316": "3,8 m", "318": "8 t", "320": "8 t"}.get(base, base)
    return (Text(words, CENTRE, 20.0, 52.0, BLACK),)


def _wedge(*corners: Point) -> Shape:
    return Polygon(corners, BLACK)


_LIMITS: dict[str, tuple[Shape, ...]] = {
    "312": (
        _wedge((14.0, 42.0), (25.0, 50.0), (14.0, 58.0)),
        _wedge((86.0, 42.0), (75.0, 50.0), (86.0, 58.0)),
    ),
    "316": (
        _wedge((42.0, 14.0), (58.0, 14.0), (50.0, 28.0)),
        _wedge((42.0, 86.0), (58.0, 86.0), (50.0, 72.0)),
    ),
    "314": (),
    "318": (),
    "320": (),
}
_ON_GROUND = {"302", "336", "337", "362", "364", "370", "372", *_LIMITS}
"""What `_on_disc` has drawn whole."""
_VEHICLE: Place = (50.0, 50.0, 42.0)
_VEHICLES: dict[str, tuple[Pictogram, Place]] = {
    "1": (draw.car, _VEHICLE),
    "3": (draw.tractor, _VEHICLE),
    "4": (draw.motorcycle, _VEHICLE),
    "5": (draw.lorry, (50.0, 50.0, 38.0)),
    "6": (draw.bicycle, (50.0, 48.0, 52.0)),
    "7": (draw.walker, (50.0, 50.0, 56.0)),
    "8": (draw.walker, (50.0, 50.0, 56.0)),
}
_RIGHT: tuple[Point, ...] = ((40.0, 78.0), (40.0, 46.0), (78.0, 46.0))
_LEFT: tuple[Point, ...] = ((60.0, 78.0), (60.0, 46.0), (22.0, 46.0))
_AHEAD: tuple[Point, ...] = ((50.0, 80.0), (50.0, 18.0))
_MANDATORY: dict[str, tuple[tuple[Point, ...], ...]] = {
    "1": (_AHEAD,),
    "2": (((20.0, 50.0), (80.0, 50.0)),),
    "3": (((80.0, 50.0), (20.0, 50.0)),),
    "4": (_RIGHT,),
    "5": (_LEFT,),
    "6": (((42.0, 80.0), (42.0, 20.0)), ((42.0, 62.0), (80.0, 44.0))),
    "7": (((58.0, 80.0), (58.0, 20.0)), ((58.0, 62.0), (20.0, 44.0))),
    "8": (((50.0, 78.0), (50.0, 46.0), (82.0, 46.0)), ((50.0, 78.0), (50.0, 46.0), (18.0, 46.0))),
}
