"""6xx service, 7xx directions, 8xx plates under a sign, 9xx markers."""

from __future__ import annotations

from twin.drawings import pictograms as draw
from twin.drawings.shapes import (
    BLACK,
    BLUE,
    RED,
    WHITE,
    YELLOW,
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


def service_face(number: str, _text: str) -> Face:
    """Blue plate with a white field and a black pictogram."""
    outline = rectangle(0.0, 0.0, 100.0, 100.0, 8.0)
    blue = Polygon(shrunk(outline, 0.95, (50.0, 50.0)), BLUE)
    field = Polygon(rectangle(16.0, 16.0, 84.0, 84.0, 4.0), WHITE)
    drawn = _SERVICES.get(number[:3])
    inside = (
        (Text(number, (50.0, 50.0), 22.0, 60.0, BLACK),)
        if drawn is None
        else placed(drawn(RED if number[:3] == "601" else BLACK, WHITE), (50.0, 50.0, 54.0))
    )
    return Face(0.6, 0.6, outline, (blue, field, *inside))


def direction_face(number: str, text: str) -> Face:
    """Yellow board with black letters; white for places and roads (727, 729), pointed for 71x."""
    base = number[:3]
    local = base in {"727", "729"}
    words = text or number
    pointed = base in {"711", "713", "717", "719"}
    left = pointed and (".V" in number or number.endswith("V"))
    height = 24.0
    if pointed:
        outline: tuple[Point, ...] = ((0.0, 0.0), (90.0, 0.0), (100.0, 12.0), (90.0, height), (0.0, height))
        if left:
            outline = tuple((100.0 - x, y) for x, y in outline)
    else:
        outline = rectangle(0.0, 0.0, 100.0, height, 3.0)
    middle = (50.0, 0.5 * height)
    ground = WHITE if local else YELLOW
    ring = Polygon(_inset(outline, middle, 1.2), BLACK), Polygon(_inset(outline, middle, 2.4), ground)
    text_at = (46.0 if pointed and not left else 54.0 if left else 50.0, 0.5 * height)
    return Face(1.8, 1.8 * height / 100.0, outline, (*ring, Text(words, text_at, 11.0, 80.0, BLACK)))


def under_plate(number: str, text: str) -> Face:
    """White plate with a black edge: a text, an arrow or a pictogram."""
    base, _, variant = number.partition(".")
    words = text or _PLATE_TEXTS.get(base, "") or (_PLATE_TEXTS.get(number, "") or number)
    shapes: tuple[Shape, ...] = (Text(words, (50.0, 18.0), 13.0, 84.0, BLACK),)
    if base == "810" and not text:
        way = ((84.0, 18.0), (16.0, 18.0)) if variant.startswith("V") else ((16.0, 18.0), (84.0, 18.0))
        shapes = arrow(way, 7.0, BLACK)
    elif base == "804" and text:
        up, down = (
            arrow(((12.0, 28.0), (12.0, 8.0)), 4.0, BLACK),
            arrow(((88.0, 28.0), (88.0, 8.0)), 4.0, BLACK),
        )
        shapes = (*up, *down, Text(text, (50.0, 18.0), 13.0, 60.0, BLACK))
    elif base == "817" and not text:
        shapes = placed(draw.car(BLACK, WHITE), (50.0, 18.0, 26.0))
    outline = rectangle(0.0, 0.0, 100.0, 36.0, 4.0)
    edge, inner = _inset(outline, (50.0, 18.0), 1.6), _inset(outline, (50.0, 18.0), 3.4)
    return Face(0.75, 0.27, outline, (Polygon(edge, BLACK), Polygon(inner, WHITE), *shapes))


def marker_face(number: str, _text: str) -> Face:
    """902 and 904 arrows of bends, 906 obstacles, 912 and the like striped boards."""
    base = number[:3]
    left = number.endswith("V") or ".V" in number
    if base == "906":
        return _striped(0.3, 0.9, YELLOW, BLACK, falls_right=left)
    if base in {"902", "904"}:
        return _chevrons(left=left, single=base == "904")
    if base in {"908", "912", "930"}:
        return _striped(
            0.9, 0.25, WHITE if base == "930" else YELLOW, RED if base == "930" else BLACK, falls_right=True
        )
    if base == "920":
        outline = rectangle(0.0, 0.0, 100.0, 500.0)
        return Face(0.12, 0.6, outline, (Polygon(rectangle(0.0, 60.0, 100.0, 200.0), BLACK),))
    outline = rectangle(0.0, 0.0, 100.0, 100.0, 4.0)
    inner = Polygon(shrunk(outline, 0.94, (50.0, 50.0)), YELLOW)
    return Face(0.5, 0.5, outline, (inner, Text(number, (50.0, 50.0), 22.0, 82.0, BLACK)))


def _striped(width_m: float, height_m: float, ground: str, ink: str, *, falls_right: bool) -> Face:
    """Diagonal stripes, cut at the plate's edge."""
    height = 100.0 * height_m / width_m
    step = 50.0 if height > 100.0 else 24.0
    shapes: list[Shape] = [Polygon(rectangle(0.0, 0.0, 100.0, height), ground)]
    start = -100.0 - step
    while start < height + 100.0:
        band = ((0.0, start), (100.0, start + 100.0), (100.0, start + 100.0 + step), (0.0, start + step))
        cut = _clipped(band, height)
        if len(cut) > 2:
            shapes.append(Polygon(tuple((x if falls_right else 100.0 - x, y) for x, y in cut), ink))
        start += 2.0 * step
    return Face(width_m, height_m, rectangle(0.0, 0.0, 100.0, height), tuple(shapes))


def _chevrons(*, left: bool, single: bool) -> Face:
    count = 1 if single else 3
    height = 100.0 if single else 34.0
    part = 100.0 / count
    shapes: list[Shape] = [Polygon(rectangle(0.0, 0.0, 100.0, height), BLACK)]
    for i in range(count):
        x, wide = i * part, 0.34 * part
        way = (
            (x + 0.14 * part, 0.08 * height),
            (x + 0.14 * part + wide, 0.08 * height),
            (x + 0.88 * part, 0.5 * height),
            (x + 0.14 * part + wide, 0.92 * height),
            (x + 0.14 * part, 0.92 * height),
            (x + 0.54 * part, 0.5 * height),
        )
        shapes.append(Polygon(tuple((100.0 - px if left else px, py) for px, py in way), YELLOW))
    width_m = 0.6 if single else 1.5
    return Face(width_m, width_m * height / 100.0, rectangle(0.0, 0.0, 100.0, height), tuple(shapes))


def _clipped(points: tuple[Point, ...], height: float) -> tuple[Point, ...]:
    """Cut a polygon at the plate's upper and lower edge (Sutherland and Hodgman)."""
    for edge, keep in ((0.0, 1.0), (height, -1.0)):
        kept: list[Point] = []
        for i, (x, y) in enumerate(points):
            x0, y0 = points[i - 1]
            inside, inside0 = keep * (y - edge) >= 0.0, keep * (y0 - edge) >= 0.0
            if inside != inside0:
                kept.append((x0 + (x - x0) * (edge - y0) / (y - y0), edge))
            if inside:
                kept.append((x, y))
        points = tuple(kept)
    return points


def _inset(outline: tuple[Point, ...], middle: Point, by: float) -> tuple[Point, ...]:
    """Draw an outline in by the same width on all sides of its box."""
    wide = 1.0 - by / 50.0
    tall = 1.0 - by / middle[1]
    return tuple((middle[0] + wide * (x - middle[0]), middle[1] + tall * (y - middle[1])) for x, y in outline)


def _cross(ink: str, _ground: str) -> tuple[Shape, ...]:
    return Polygon(rectangle(-0.5, -0.16, 0.5, 0.16), ink), Polygon(rectangle(-0.16, -0.5, 0.16, 0.5), ink)


def _caravan(ink: str, ground: str) -> tuple[Shape, ...]:
    return (
        Polygon(rectangle(-0.5, -0.3, 0.42, 0.26, 0.1), ink),
        Polygon(rectangle(-0.34, -0.16, 0.0, 0.06), ground),
        Line(((0.42, 0.24), (0.62, 0.24)), 0.06, ink),
        Disc((0.0, 0.3), 0.14, ink),
    )


def _tent(ink: str, ground: str) -> tuple[Shape, ...]:
    return (
        Polygon(((0.0, -0.4), (0.6, 0.4), (-0.6, 0.4)), ink),
        Polygon(((0.0, -0.05), (0.2, 0.4), (-0.2, 0.4)), ground),
    )


_SERVICES: dict[str, draw.Pictogram] = {
    "601": _cross,
    "605": draw.fuel,
    "610": draw.cutlery,
    "612": draw.cutlery,
    "613": draw.bed,
    "614": draw.bed,
    "616": _tent,
    "618": _caravan,
    "621": draw.letter("P"),
    "635": draw.letter("i"),
    "640": draw.letter("WC"),
}
_PLATE_TEXTS = {
    "802": "Avstand",
    "804": "Utstrekning",
    "806": "Tid",
    "808.105": "Fartsdempere",
    "829": "Svaksynte",
}
