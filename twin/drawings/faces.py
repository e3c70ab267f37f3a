"""Which face a sign code has: by its own drawing, else by its family's shape."""

from __future__ import annotations

from functools import lru_cache

from twin.drawings.boards import direction_face, marker_face, service_face, under_plate
from twin.drawings.discs import mandatory_face, prohibition_face
from twin.drawings.information import information_face
from twin.drawings.shapes import BLACK, GREY, WHITE, Face, Polygon, Text, rectangle, shrunk
from twin.drawings.triangles import priority_face, warning_face

_FAMILIES = {
    "1": warning_face,
    "2": priority_face,
    "3": prohibition_face,
    "4": mandatory_face,
    "5": information_face,
    "6": service_face,
    "7": direction_face,
    "8": under_plate,
    "9": marker_face,
}


@lru_cache(maxsize=512)
def face(code: str, text: str = "") -> Face:
    """Describe a sign: its size, its outline and what is painted on it.

    Parameters
    ----------
    code : str
        Skiltnummer, ``362.50``; a ``U`` in front (retired, still standing) changes nothing.
    text : str
        What is written on the plate, where the code leaves that open.

    Returns
    -------
    Face
        A code that is not known has the shape of its family, and itself written in it; one without a
        family a plain grey plate.
    """
    number = code.strip().upper().removeprefix("U")
    family = _FAMILIES.get(number[:1]) if number[:3].isdigit() else None
    return _plain(code) if family is None else family(number, text)


def _plain(code: str) -> Face:
    outline = rectangle(0.0, 0.0, 100.0, 100.0, 8.0)
    inner = shrunk(outline, 0.92, (50.0, 50.0))
    text = Text(code.strip() or "?", (50.0, 50.0), 26.0, 84.0, BLACK)
    return Face(0.7, 0.7, outline, (Polygon(outline, GREY), Polygon(inner, WHITE), text))
