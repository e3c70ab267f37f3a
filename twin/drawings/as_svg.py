"""A sign face as SVG: presentation attributes alone, so that a page's CSP has nothing to object to."""

from __future__ import annotations

from collections.abc import Iterable
from xml.sax.saxutils import escape

from twin.drawings.faces import face
from twin.drawings.shapes import WHITE, Disc, Line, Point, Polygon, Shape, Text

CAP_HEIGHT = 0.729
LETTER_WIDTH = 0.74
"""Of DejaVu Sans Bold, in its size: the height of capitals, and a generous mean width."""
MARGIN = 2.0


def svg(code: str, text: str = "") -> str:
    """Draw a Norwegian sign.

    Parameters
    ----------
    code : str
        Skiltnummer. One that is not known gets the shape of its family with the code written in it.
    text : str
        What is written on the plate, where the code leaves that open (``150 m`` on an 802).

    Returns
    -------
    str
        A whole SVG document, transparent around the plate.
    """
    sign = face(code, text)
    low, width, height = -MARGIN, 100.0 + 2 * MARGIN, sign.height + 2 * MARGIN
    body = "".join(_element(shape) for shape in sign.shapes)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{low:g} {low:g} {width:g} {height:.4g}" '
        f'role="img" aria-label="{escape(code, {chr(34): "&quot;"})}">'
        f'<polygon points="{_points(sign.outline)}" fill="{WHITE}" stroke="#5f6368" stroke-width="1.5"/>'
        f"{body}</svg>"
    )


def _element(shape: Shape) -> str:
    match shape:
        case Polygon(points, colour):
            return f'<polygon points="{_points(points)}" fill="{colour}"/>'
        case Disc((x, y), radius, colour):
            return f'<circle cx="{x:.4g}" cy="{y:.4g}" r="{radius:.4g}" fill="{colour}"/>'
        case Line(points, width, colour):
            return (
                f'<polyline points="{_points(points)}" fill="none" stroke="{colour}" '
                f'stroke-width="{width:.4g}" stroke-linecap="round" stroke-linejoin="round"/>'
            )
        case Text(words, (x, y), height, room, colour):
            size = min(height / CAP_HEIGHT, room / (LETTER_WIDTH * max(len(words), 1)))
            return (
                f'<text x="{x:.4g}" y="{y + 0.5 * CAP_HEIGHT * size:.4g}" fill="{colour}" '
                f'font-family="DejaVu Sans, Verdana, Arial, sans-serif" font-weight="bold" '
                f'font-size="{size:.4g}" text-anchor="middle">{escape(words)}</text>'
            )


def _points(points: Iterable[Point]) -> str:
    return " ".join(f"{x:.4g},{y:.4g}" for x, y in points)
