"""5xx: blue plates that tell and allow."""

from __future__ import annotations

from collections.abc import Callable

from twin.drawings import pictograms as draw
from twin.drawings.shapes import (
    BLACK,
    BLUE,
    RED,
    WHITE,
    Disc,
    Face,
    Line,
    Point,
    Polygon,
    Shape,
    Text,
    arrow,
    placed,
    rectangle,
    shrunk,
)

SQUARE_M = 0.7
_ENDED = {"504", "505", "511", "541"}
"""Signs that end what the one before them began: the same drawing with a red bar."""


def information_face(number: str, text: str) -> Face:
    """Return a blue square or upright rectangle with what it tells."""
    base, _, variant = number.partition(".")
    if base in {"526", "527"}:
        return _one_way(base, variant)
    drawn = _DRAWN.get(base)
    if drawn is None:
        return _square((Text(number, (50.0, 50.0), 26.0, 80.0, WHITE),))
    if base == "552":
        words = (Text(text, (50.0, 84.0), 10.0, 84.0, WHITE),) if text else ()
        return _square((*drawn(variant), *words))
    ended = (Line(((88.0, 12.0), (12.0, 88.0)), 8.0, RED),) if base in _ENDED else ()
    return _square((*drawn(variant), *ended))


def _square(shapes: tuple[Shape, ...]) -> Face:
    outline = rectangle(0.0, 0.0, 100.0, 100.0, 8.0)
    inner = shrunk(outline, 0.95, (50.0, 50.0))
    return Face(SQUARE_M, SQUARE_M, outline, (Polygon(inner, BLUE), *shapes))


def _one_way(base: str, variant: str) -> Face:
    if base == "527":
        bars = (
            Line(((50.0, 84.0), (50.0, 40.0)), 13.0, WHITE),
            Line(((28.0, 32.0), (72.0, 32.0)), 13.0, RED),
        )
        return _square(bars)
    if variant == "1":
        return _square(arrow(((50.0, 86.0), (50.0, 12.0)), 15.0, WHITE))
    outline = rectangle(0.0, 0.0, 100.0, 36.0, 4.0)
    inner = shrunk(outline, 0.95, (50.0, 18.0))
    way = ((10.0, 18.0), (90.0, 18.0))
    return Face(0.9, 0.324, outline, (Polygon(inner, BLUE), *arrow(way, 8.0, WHITE)))


def _crossing(_variant: str) -> tuple[Shape, ...]:
    """A person on stripes in a white triangle."""
    stripes = tuple(
        Polygon(((x, 78.0), (x + 7.0, 78.0), (x + 9.0, 86.0), (x - 1.0, 86.0)), BLACK)
        for x in (22.0, 36.0, 50.0, 64.0)
    )
    triangle = Polygon(((50.0, 8.0), (95.0, 88.0), (5.0, 88.0)), WHITE)
    return (triangle, *stripes, *placed(draw.walker(BLACK, WHITE), (50.0, 52.0, 54.0)))


def _in_white(pictogram: draw.Pictogram, size: float) -> Callable[[str], tuple[Shape, ...]]:
    """Return a black pictogram on a white field, as on stops."""

    def drawn(_variant: str) -> tuple[Shape, ...]:
        field = Polygon(rectangle(14.0, 18.0, 86.0, 82.0, 3.0), WHITE)
        return (field, *placed(pictogram(BLACK, WHITE), (50.0, 50.0, size)))

    return drawn


def _in_blue(pictogram: draw.Pictogram, size: float) -> Callable[[str], tuple[Shape, ...]]:
    def drawn(_variant: str) -> tuple[Shape, ...]:
        return placed(pictogram(WHITE, BLUE), (50.0, 50.0, size))

    return drawn


def _shared(_variant: str) -> tuple[Shape, ...]:
    """A person above a bicycle."""
    return (
        *placed(draw.walker(WHITE, BLUE), (50.0, 30.0, 44.0)),
        Line(((14.0, 56.0), (86.0, 56.0)), 2.5, WHITE),
        *placed(draw.bicycle(WHITE, BLUE), (50.0, 78.0, 46.0)),
    )


def _lane(pictogram: draw.Pictogram, size: float) -> Callable[[str], tuple[Shape, ...]]:
    def drawn(_variant: str) -> tuple[Shape, ...]:
        edge = Line(((14.0, 90.0), (14.0, 12.0)), 3.0, WHITE)
        way = arrow(((76.0, 88.0), (76.0, 16.0)), 9.0, WHITE)
        return (edge, *placed(pictogram(WHITE, BLUE), (43.0, 50.0, size)), *way)

    return drawn


def _motorway(_variant: str) -> tuple[Shape, ...]:
    lanes: tuple[tuple[Point, ...], ...] = (((24.0, 88.0), (44.0, 14.0)), ((76.0, 88.0), (56.0, 14.0)))
    return *(Line(lane, 10.0, WHITE) for lane in lanes), Line(((16.0, 36.0), (84.0, 36.0)), 7.0, WHITE)


def _yard(_variant: str) -> tuple[Shape, ...]:
    house = Polygon(((58.0, 44.0), (75.0, 28.0), (92.0, 44.0), (92.0, 74.0), (58.0, 74.0)), WHITE)
    return (
        house,
        *placed(draw.walker(WHITE, BLUE), (22.0, 50.0, 44.0)),
        *placed(draw.car(WHITE, BLUE), (54.0, 82.0, 22.0)),
    )


def _passing_place(_variant: str) -> tuple[Shape, ...]:
    return (Text("M", (50.0, 50.0), 54.0, 70.0, WHITE),)


def _camera(_variant: str) -> tuple[Shape, ...]:
    return (
        Polygon(rectangle(20.0, 36.0, 80.0, 72.0, 5.0), WHITE),
        Polygon(rectangle(40.0, 27.0, 60.0, 38.0), WHITE),
        Disc((50.0, 54.0), 13.0, BLUE),
        Disc((50.0, 54.0), 7.0, WHITE),
    )


_DRAWN: dict[str, Callable[[str], tuple[Shape, ...]]] = {
    "502": _motorway,
    "503": _in_blue(draw.car, 62.0),
    "504": _motorway,
    "505": _in_blue(draw.car, 62.0),
    "508": _lane(draw.bus, 34.0),
    "510": _lane(draw.bus, 34.0),
    "511": _lane(draw.bus, 34.0),
    "512": _in_white(draw.bus, 42.0),
    "514": _in_white(draw.letter("TAXI"), 34.0),
    "516": _crossing,
    "518": _in_blue(draw.walker, 78.0),
    "520": _in_blue(draw.bicycle, 62.0),
    "521": _lane(draw.bicycle, 42.0),
    "522": _shared,
    "524": _passing_place,
    "540": _yard,
    "541": _yard,
    "552": _in_blue(draw.letter("P"), 88.0),
    "558": _camera,
}
