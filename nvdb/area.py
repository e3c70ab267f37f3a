"""Which part of the country to ask for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from nvdb.errors import AreaError
from nvdb.geometri import NORWAY_UTM33


@dataclass(frozen=True, slots=True)
class Area:
    """Kommuner, a box, or (neither given) the whole country.

    Attributes
    ----------
    kommuner : tuple of int
        Kommune numbers: 301 is 0301 Oslo. Kept sorted, each once.
    bbox : (min east, min north, max east, max north) or None
        EPSG:25833, metres.

    Raises
    ------
    AreaError
        Both given, a number that cannot be a kommune, or a box that is empty or outside Norway.
    """

    kommuner: tuple[int, ...] = ()
    bbox: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.kommuner and self.bbox is not None:
            msg = "An area is either kommuner or a box: give one of them."
            raise AreaError(msg)
        for number in self.kommuner:
            if isinstance(number, bool) or not isinstance(number, int) or not 101 <= number <= 9999:
                msg = f"{number!r} is no kommune number: give four digits, such as 5001 or 0301."
                raise AreaError(msg)
        object.__setattr__(self, "kommuner", tuple(sorted(set(self.kommuner))))
        if self.bbox is not None:
            object.__setattr__(self, "bbox", _checked_box(self.bbox))

    @classmethod
    def from_kommuner_text(cls, text: str) -> Area:
        """Read ``5001,0301``."""
        parts = [part.strip() for part in text.split(",")]
        if not all(part.isascii() and part.isdigit() and len(part) <= 4 for part in parts):
            msg = f"{text!r} is not a list of kommuner: give numbers with commas between, such as 5001,0301."
            raise AreaError(msg)
        return cls(kommuner=tuple(int(part) for part in parts))

    @classmethod
    def from_bbox_text(cls, text: str) -> Area:
        """Read ``E,N,E,N``: two opposite corners in UTM33 metres, lower left first."""
        try:
            numbers = tuple(float(part) for part in text.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) != 4:
            msg = f"{text!r} is not a box: give minE,minN,maxE,maxN in UTM33 metres."
            raise AreaError(msg)
        return cls(bbox=(numbers[0], numbers[1], numbers[2], numbers[3]))

    def params(self) -> dict[str, str]:
        """Query parameters of API Les V4; coordinates there are UTM33 for every UTM srid."""
        if self.kommuner:
            return {"kommune": ",".join(map(str, self.kommuner))}
        if self.bbox is not None:
            return {"kartutsnitt": ",".join(f"{number:.3f}" for number in self.bbox)}
        return {}

    def text(self) -> str:
        """In words, for people and for the store."""
        if self.kommuner:
            return "kommune " + ", ".join(f"{number:04d}" for number in self.kommuner)
        if self.bbox is not None:
            return "box " + ", ".join(f"{number:.0f}" for number in self.bbox) + " (UTM33)"
        return "the whole country"


def _checked_box(bbox: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return the box as floats, or raise with a guess at what went wrong."""
    text = ",".join(f"{number:g}" for number in bbox)
    if len(bbox) != 4 or not all(math.isfinite(number) for number in bbox):
        msg = f"The box {text} needs four finite numbers: minE,minN,maxE,maxN in UTM33 metres."
        raise AreaError(msg)
    min_east, min_north, max_east, max_north = (float(number) for number in bbox)
    if all(abs(number) <= 180 for number in bbox):
        msg = f"The box {text} looks like degrees: give minE,minN,maxE,maxN in UTM33 metres."
        raise AreaError(msg)
    if not (min_east < max_east and min_north < max_north):
        msg = f"The box {text} is empty: give the lower left corner first (minE,minN,maxE,maxN)."
        raise AreaError(msg)
    west, south, east, north = NORWAY_UTM33
    if min_east > east or max_east < west or min_north > north or max_north < south:
        msg = f"The box {text} lies outside Norway: give minE,minN,maxE,maxN in UTM33 (EPSG:25833) metres."
        raise AreaError(msg)
    return min_east, min_north, max_east, max_north
