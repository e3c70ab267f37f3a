"""Which part of the country to ask for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from nvdb.errors import AreaError
from nvdb.objects.geometri import NORWAY_UTM33

_COUNTRY: Final = "the whole country"
_UTM33: Final = "(UTM33)"


@dataclass(frozen=True, slots=True)
class Area:
    """Kommuner, fylker, kontraktsområder, a box, or (none of them given) the whole country.

    Attributes
    ----------
    kommuner : tuple of int
        Kommune numbers: 301 is 0301 Oslo. Kept sorted, each once.
    fylker : tuple of int
        Fylke numbers: 50 is Trøndelag. Kept sorted, each once.
    kontraktsomrader : tuple of str
        Whole names, or ids, of operation contracts. Kept sorted, each once.
    bbox : (min east, min north, max east, max north) or None
        EPSG:25833, metres, to the millimetre.

    Raises
    ------
    AreaError
        More than one given, a number that cannot be a kommune or fylke, a name that cannot be asked for, or a
        box that is empty or outside Norway.
    """

    kommuner: tuple[int, ...] = ()
    fylker: tuple[int, ...] = ()
    kontraktsomrader: tuple[str, ...] = ()
    bbox: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        if sum(map(bool, (self.kommuner, self.fylker, self.kontraktsomrader, self.bbox is not None))) > 1:
            msg = "An area is either kommuner, fylker, kontraktsområder or a box: give one of them."
            raise AreaError(msg)
        _check_numbers(self.kommuner, range(101, 10_000), "kommune number: give four digits, such as 5001")
        _check_numbers(self.fylker, range(1, 100), "fylke number: give two digits, such as 50")
        names = tuple(name.strip() if isinstance(name, str) else "" for name in self.kontraktsomrader)
        if not all(name and "," not in name for name in names):
            msg = f"{self.kontraktsomrader} are no kontraktsområder: give names without commas, or ids."
            raise AreaError(msg)
        object.__setattr__(self, "kommuner", tuple(sorted(set(self.kommuner))))
        object.__setattr__(self, "fylker", tuple(sorted(set(self.fylker))))
        object.__setattr__(self, "kontraktsomrader", tuple(sorted(set(names))))
        if self.bbox is not None:
            object.__setattr__(self, "bbox", _checked_box(self.bbox))

    @classmethod
    def from_kommuner_text(cls, text: str) -> Area:
        """Read ``5001,0301``."""
        return cls(kommuner=_numbers(text, 4, "kommuner", "5001,0301"))

    @classmethod
    def from_fylker_text(cls, text: str) -> Area:
        """Read ``50,03``."""
        return cls(fylker=_numbers(text, 2, "fylker", "50,03"))

    @classmethod
    def from_kontraktsomrader_text(cls, text: str) -> Area:
        """Read ``9503 Midtre Hålogaland 2021-2026``: names or ids, with commas between."""
        return cls(kontraktsomrader=tuple(text.split(",")))

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

    @classmethod
    def from_text(cls, text: str) -> Area:
        """Read what :meth:`text` wrote."""
        kind, _, rest = text.partition(" ")
        if text == _COUNTRY:
            return cls()
        if kind == "kommune":
            return cls.from_kommuner_text(rest)
        if kind == "fylke":
            return cls.from_fylker_text(rest)
        if kind == "kontraktsområde":
            return cls.from_kontraktsomrader_text(rest)
        if kind == "box":
            return cls.from_bbox_text(rest.removesuffix(_UTM33))
        msg = f"{text!r} names no area: say it anew."
        raise AreaError(msg)

    @property
    def is_administrative(self) -> bool:
        """Whether kommuner, fylker or kontraktsområder are given."""
        return bool(self.kommuner or self.fylker or self.kontraktsomrader)

    def params(self) -> dict[str, str]:
        """Query parameters of API Les V4; coordinates there are UTM33 for every UTM srid."""
        if self.kommuner:
            return {"kommune": ",".join(map(str, self.kommuner))}
        if self.fylker:
            return {"fylke": ",".join(map(str, self.fylker))}
        if self.kontraktsomrader:
            return {"kontraktsomrade": ",".join(self.kontraktsomrader)}
        if self.bbox is not None:
            return {"kartutsnitt": ",".join(f"{number:.3f}" for number in self.bbox)}
        return {}

    def text(self) -> str:
        """In words, for people and for the store; areas that differ have different words."""
        if self.kommuner:
            return "kommune " + ", ".join(f"{number:04d}" for number in self.kommuner)
        if self.fylker:
            return "fylke " + ", ".join(f"{number:02d}" for number in self.fylker)
        if self.kontraktsomrader:
            return "kontraktsområde " + ", ".join(self.kontraktsomrader)
        if self.bbox is not None:
            shown = (f"{number:.3f}".rstrip("0").rstrip(".") for number in self.bbox)
            return f"box {', '.join(shown)} {_UTM33}"
        return _COUNTRY

    def contains(self, other: Area) -> bool:
        """Whether all kommuner, fylker or kontraktsområder of another area are named in this one too."""
        pairs = (
            (other.kommuner, self.kommuner),
            (other.fylker, self.fylker),
            (other.kontraktsomrader, self.kontraktsomrader),
        )
        return any(theirs and set(theirs) <= set(ours) for theirs, ours in pairs)

    def excludes(self, lokasjon: object) -> bool:
        """Whether an object's ``lokasjon`` of API Les V4 says that it lies elsewhere.

        False for a box, whose measure (own geometry or road) is the API's to know, and for an object without
        ``lokasjon``. The API leaves ``kontraktsområder`` out where there are none.
        """
        if not (self.is_administrative and isinstance(lokasjon, Mapping)):
            return False
        if self.kontraktsomrader:
            wanted = {name.casefold() for name in self.kontraktsomrader}
            return wanted.isdisjoint(_names(lokasjon.get("kontraktsområder")))
        name, numbers = ("kommuner", self.kommuner) if self.kommuner else ("fylker", self.fylker)
        found = lokasjon.get(name)
        return isinstance(found, list) and set(numbers).isdisjoint(found)


READERS: Final[Mapping[str, Callable[[str], Area]]] = {
    "kommune": Area.from_kommuner_text,
    "fylke": Area.from_fylker_text,
    "kontraktsomrade": Area.from_kontraktsomrader_text,
    "bbox": Area.from_bbox_text,
}
"""How an area is named → what reads it as typed."""


def _check_numbers(numbers: tuple[int, ...], possible: range, what: str) -> None:
    for number in numbers:
        if isinstance(number, bool) or not isinstance(number, int) or number not in possible:
            msg = f"{number!r} is no {what}."
            raise AreaError(msg)


def _numbers(text: str, digits: int, what: str, example: str) -> tuple[int, ...]:
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdigit() and len(part) <= digits for part in parts):
        msg = f"{text!r} is not a list of {what}: give numbers with commas between, such as {example}."
        raise AreaError(msg)
    return tuple(int(part) for part in parts)


def _names(kontraktsomrader: object) -> set[str]:
    """What kontraktsområder are called: id, number and name of each."""
    items: list[Any] = kontraktsomrader if isinstance(kontraktsomrader, list) else []
    return {
        str(item[name]).casefold()
        for item in items
        if isinstance(item, Mapping)
        for name in ("id", "nummer", "navn")
        if name in item
    }


def _checked_box(bbox: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return the box as floats, or raise with a guess at what went wrong."""
    text = ",".join(f"{number:g}" for number in bbox)
    if len(bbox) != 4 or not all(math.isfinite(number) for number in bbox):
        msg = f"The box {text} needs four finite numbers: minE,minN,maxE,maxN in UTM33 metres."
        raise AreaError(msg)
    min_east, min_north, max_east, max_north = (round(float(number), 3) for number in bbox)
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
