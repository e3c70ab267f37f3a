"""Pictograms in a box of height 1 around (0, 0), y down: functions of their colour and the ground's."""

from __future__ import annotations

from collections.abc import Callable

from twin.drawings.shapes import Disc, Line, Polygon, Shape, Text, arc, arrow, rectangle

Pictogram = Callable[[str, str], tuple[Shape, ...]]


def walker(ink: str, _ground: str) -> tuple[Shape, ...]:
    """A person who walks to the left."""
    return (
        Disc((0.0, -0.40), 0.09, ink),
        Polygon(((-0.09, -0.28), (0.09, -0.28), (0.11, 0.06), (-0.08, 0.06)), ink),
        Line(((-0.07, -0.24), (-0.21, -0.05), (-0.26, 0.02)), 0.065, ink),
        Line(((0.07, -0.24), (0.19, -0.08), (0.15, 0.04)), 0.065, ink),
        Line(((-0.03, 0.04), (-0.12, 0.24), (-0.22, 0.46)), 0.09, ink),
        Line(((0.06, 0.04), (0.12, 0.25), (0.24, 0.45)), 0.09, ink),
    )


def children(ink: str, _ground: str) -> tuple[Shape, ...]:
    """Two children who run, the one behind smaller."""
    big = _runner(ink)
    small = tuple(_scaled(shape, 0.78, 0.34, 0.11) for shape in _runner(ink))
    return (*(_scaled(shape, 1.0, -0.20, 0.0) for shape in big), *small)


def _runner(ink: str) -> tuple[Shape, ...]:
    return (
        Disc((-0.06, -0.40), 0.095, ink),
        Polygon(((-0.14, -0.28), (0.05, -0.27), (0.11, 0.06), (-0.06, 0.08)), ink),
        Line(((-0.10, -0.23), (-0.24, -0.12), (-0.32, -0.22)), 0.065, ink),
        Line(((0.04, -0.22), (0.16, -0.08), (0.24, -0.15)), 0.065, ink),
        Line(((-0.01, 0.05), (-0.16, 0.20), (-0.10, 0.45)), 0.085, ink),
        Line(((0.06, 0.04), (0.17, 0.24), (0.34, 0.26)), 0.085, ink),
    )


def _scaled(shape: Shape, factor: float, right: float, down: float) -> Shape:
    from twin.drawings.shapes import placed

    return placed([shape], (right, down, factor))[0]


def bicycle(ink: str, _ground: str) -> tuple[Shape, ...]:
    """A bicycle, seen from the side."""
    rear, front = (-0.42, 0.16), (0.42, 0.16)
    wheels = tuple(Line((*arc(hub, 0.26, 0.0, 360.0, 24),), 0.06, ink) for hub in (rear, front))
    return (
        *wheels,
        Line((rear, (-0.18, -0.18), (0.26, -0.18), (-0.02, 0.16), rear), 0.055, ink),
        Line(((-0.22, -0.30), (-0.02, 0.16)), 0.055, ink),
        Line((front, (0.24, -0.34), (0.10, -0.36)), 0.055, ink),
        Line(((-0.32, -0.31), (-0.13, -0.31)), 0.07, ink),
    )


def bus(ink: str, ground: str) -> tuple[Shape, ...]:
    """A bus, seen from the side."""
    windows = tuple(
        Polygon(rectangle(left, -0.26, left + 0.23, -0.02, 0.03), ground)
        for left in (-0.70, -0.42, -0.14, 0.14, 0.43)
    )
    return (
        Polygon(rectangle(-0.80, -0.38, 0.76, 0.28, 0.08), ink),
        *windows,
        *(Disc((x, 0.28), 0.15, ground) for x in (-0.45, 0.43)),
        *(Disc((x, 0.28), 0.12, ink) for x in (-0.45, 0.43)),
    )


def lorry(ink: str, ground: str) -> tuple[Shape, ...]:
    """A lorry, seen from the side, driving left."""
    return (
        Polygon(rectangle(-0.28, -0.42, 0.78, 0.24, 0.03), ink),
        Polygon(((-0.78, 0.24), (-0.78, -0.02), (-0.62, -0.26), (-0.34, -0.26), (-0.34, 0.24)), ink),
        Polygon(((-0.68, -0.02), (-0.58, -0.18), (-0.42, -0.18), (-0.42, -0.02)), ground),
        *(Disc((x, 0.26), 0.17, ground) for x in (-0.52, 0.48)),
        *(Disc((x, 0.26), 0.13, ink) for x in (-0.52, 0.48)),
    )


def car(ink: str, ground: str) -> tuple[Shape, ...]:
    """A car from the front."""
    roof = ((-0.28, -0.36), (0.28, -0.36), (0.40, -0.04), (-0.40, -0.04))
    return (
        Polygon(roof, ink),
        Polygon(((-0.22, -0.28), (0.22, -0.28), (0.29, -0.06), (-0.29, -0.06)), ground),
        Polygon(rectangle(-0.48, -0.06, 0.48, 0.28, 0.07), ink),
        *(Disc((x, 0.08), 0.07, ground) for x in (-0.31, 0.31)),
        *(Polygon(rectangle(x - 0.09, 0.22, x + 0.09, 0.42, 0.03), ink) for x in (-0.35, 0.35)),
    )


def motorcycle(ink: str, _ground: str) -> tuple[Shape, ...]:
    """A motorcycle with its rider."""
    return (
        *(Line(arc((x, 0.26), 0.18, 0.0, 360.0, 20), 0.08, ink) for x in (-0.42, 0.42)),
        Polygon(((-0.46, -0.02), (0.30, -0.08), (0.34, 0.12), (-0.20, 0.22)), ink),
        Line(((0.40, 0.24), (0.24, -0.22)), 0.06, ink),
        Polygon(((-0.20, -0.04), (-0.06, -0.34), (0.10, -0.34), (0.02, -0.02)), ink),
        Line(((0.02, -0.28), (0.26, -0.18)), 0.07, ink),
        Disc((0.04, -0.44), 0.11, ink),
    )


def tractor(ink: str, ground: str) -> tuple[Shape, ...]:
    """A tractor."""
    return (
        Polygon(rectangle(-0.44, -0.06, 0.16, 0.20, 0.02), ink),
        Line(((0.06, -0.04), (0.06, -0.38), (0.42, -0.38), (0.46, 0.0)), 0.06, ink),
        Line(((-0.26, -0.06), (-0.26, -0.30)), 0.06, ink),
        Disc((0.30, 0.16), 0.28, ink),
        Disc((0.30, 0.16), 0.12, ground),
        Disc((-0.36, 0.28), 0.16, ink),
    )


def moose(ink: str, _ground: str) -> tuple[Shape, ...]:
    """A moose that looks left."""
    return (
        Polygon(
            (
                (-0.62, -0.16),
                (-0.44, -0.30),
                (-0.22, -0.26),
                (0.10, -0.20),
                (0.42, -0.16),
                (0.50, 0.02),
                (0.44, 0.14),
                (-0.08, 0.12),
                (-0.26, 0.02),
                (-0.36, -0.10),
                (-0.56, -0.04),
            ),
            ink,
        ),
        *(Line((top, knee, foot), 0.065, ink) for top, knee, foot in _LEGS),
        Line(((-0.36, -0.28), (-0.26, -0.44), (-0.44, -0.50)), 0.05, ink),
        Line(((-0.28, -0.42), (-0.12, -0.50)), 0.05, ink),
        Line(((-0.44, -0.28), (-0.56, -0.40), (-0.52, -0.50)), 0.05, ink),
    )


_LEGS = (
    ((-0.12, 0.06), (-0.20, 0.28), (-0.14, 0.50)),
    ((-0.02, 0.08), (0.04, 0.30), (0.00, 0.50)),
    ((0.34, 0.08), (0.28, 0.28), (0.30, 0.50)),
    ((0.44, 0.06), (0.50, 0.26), (0.46, 0.50)),
)


def bumps(ink: str, _ground: str) -> tuple[Shape, ...]:
    """Two humps of an uneven road."""
    top = (*arc((-0.24, 0.14), 0.22, 180.0, 360.0), *arc((0.24, 0.14), 0.22, 180.0, 360.0))
    return (Polygon((*top, (0.60, 0.14), (0.60, 0.26), (-0.60, 0.26), (-0.60, 0.14)), ink),)


def hump(ink: str, _ground: str) -> tuple[Shape, ...]:
    """One hump."""
    top = arc((0.0, 0.20), 0.34, 190.0, 350.0)
    return (Polygon((*top, (0.60, 0.14), (0.60, 0.26), (-0.60, 0.26), (-0.60, 0.14)), ink),)


def digger(ink: str, _ground: str) -> tuple[Shape, ...]:
    """A person who digs, as for road works."""
    return (
        Disc((-0.04, -0.38), 0.10, ink),
        Polygon(((-0.10, -0.26), (0.08, -0.22), (0.22, 0.10), (0.06, 0.16)), ink),
        Line(((-0.06, -0.20), (-0.26, 0.0)), 0.07, ink),
        Line(((0.12, 0.10), (0.02, 0.26), (0.06, 0.48)), 0.09, ink),
        Line(((0.16, 0.10), (0.30, 0.26), (0.32, 0.48)), 0.09, ink),
        Line(((-0.06, -0.14), (-0.40, 0.30)), 0.05, ink),
        Polygon(((-0.72, 0.48), (-0.56, 0.28), (-0.40, 0.22), (-0.26, 0.36), (-0.20, 0.48)), ink),
    )


def skid(ink: str, ground: str) -> tuple[Shape, ...]:
    """A car above two tracks that swing."""
    tracks = []
    for x in (-0.14, 0.14):
        way = (
            (x, 0.06),
            (x + 0.10, 0.16),
            (x + 0.08, 0.26),
            (x - 0.08, 0.34),
            (x - 0.08, 0.42),
            (x + 0.04, 0.50),
        )
        tracks.append(Line(way, 0.06, ink))
    return (*(_scaled(shape, 0.6, 0.0, -0.26) for shape in car(ink, ground)), *tracks)


def exclamation(ink: str, _ground: str) -> tuple[Shape, ...]:
    """An exclamation mark."""
    return (
        Polygon(((-0.09, -0.48), (0.09, -0.48), (0.05, 0.20), (-0.05, 0.20)), ink),
        Disc((0.0, 0.38), 0.09, ink),
    )


def roundabout(ink: str, _ground: str) -> tuple[Shape, ...]:
    """Three arrows round a circle, against the clock."""
    shapes: list[Shape] = []
    for start in (-20.0, 100.0, 220.0):
        way = arc((0.0, 0.0), 0.36, start + 80.0, start)
        shapes += arrow((*way[:-2], way[-1]), 0.13, ink, head=2.4)
    return tuple(shapes)


def fuel(ink: str, ground: str) -> tuple[Shape, ...]:
    """A petrol pump."""
    return (
        Polygon(rectangle(-0.32, -0.46, 0.14, 0.46, 0.04), ink),
        Polygon(rectangle(-0.22, -0.34, 0.04, -0.10), ground),
        Line(
            ((0.14, -0.02), (0.26, 0.04), (0.26, 0.30), (0.38, 0.30), (0.38, -0.16), (0.24, -0.34)), 0.06, ink
        ),
    )


def cutlery(ink: str, _ground: str) -> tuple[Shape, ...]:
    """Fork and knife."""
    prongs = tuple(Line(((x, -0.46), (x, -0.18)), 0.05, ink) for x in (-0.30, -0.20, -0.10))
    return (
        *prongs,
        Line(((-0.30, -0.18), (-0.10, -0.18)), 0.06, ink),
        Line(((-0.20, -0.18), (-0.20, 0.46)), 0.09, ink),
        Polygon(((0.16, -0.48), (0.30, -0.34), (0.30, 0.06), (0.16, 0.06)), ink),
        Line(((0.21, 0.04), (0.21, 0.46)), 0.09, ink),
    )


def bed(ink: str, _ground: str) -> tuple[Shape, ...]:
    """A bed."""
    return (
        Line(((-0.46, -0.30), (-0.46, 0.34)), 0.08, ink),
        Polygon(rectangle(-0.46, 0.04, 0.48, 0.18), ink),
        Line(((0.46, 0.06), (0.46, 0.34)), 0.08, ink),
        Disc((-0.28, -0.10), 0.10, ink),
        Polygon(rectangle(-0.14, -0.14, 0.46, 0.02, 0.06), ink),
    )


def letter(words: str) -> Pictogram:
    """A text in place of a pictogram."""

    def draw(ink: str, _ground: str) -> tuple[Shape, ...]:
        return (Text(words, (0.0, 0.0), 0.72, 1.5, ink),)

    return draw
