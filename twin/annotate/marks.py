"""What a person has marked: feet and faces in pictures, the codes of signs, and the way back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from geoloc.locate.records import Kind

_FIRST = "A"
"""Objects are named A001, A002, …: other tools' numbers stay theirs."""
_MOST_UNDONE = 500


class Where(NamedTuple):
    """What a mark is of: there is one of each at the most."""

    object: str
    camera: str
    frame: int
    kind: Kind


@dataclass(frozen=True, slots=True)
class Mark:
    """One mark.

    Attributes
    ----------
    place_px : (x, y) or (left, top, right, bottom)
        A foot or a box; (0, 0) is the centre of the first pixel.
    is_measured : bool
        Whether a person put it there. A proposal that was confirmed as it stood is not: its error is that of
        the projection, the same in every picture. It says that the sign was seen, and nothing of where.
    """

    place_px: tuple[float, ...]
    is_measured: bool = True

    @property
    def pixel_px(self) -> tuple[float, float]:
        """The foot, or the middle of the box."""
        if len(self.place_px) == 2:
            return self.place_px[0], self.place_px[1]
        left, top, right, bottom = self.place_px
        return (left + right) / 2, (top + bottom) / 2


@dataclass(frozen=True, slots=True)
class Sign:
    """What is said of an object: its codes top down, joined by ``;``, and who marked it first."""

    codes: str = ""
    by: str = ""


@dataclass(frozen=True, slots=True)
class Page:
    """All marks at one moment; never changed, so that an earlier one can come back."""

    signs: Mapping[str, Sign]
    marks: Mapping[Where, Mark]


class Book:
    """The marks as they are, and as they were.

    Parameters
    ----------
    page : Page
        What the folder holds.
    taken : iterable of str
        Names of objects that others have given.
    """

    def __init__(self, page: Page, taken: Iterable[str] = ()) -> None:
        self.page = page
        self._taken = set(taken)
        self._before: list[Page] = []

    @property
    def can_undo(self) -> bool:
        """Whether there is something to take back."""
        return bool(self._before)

    def new_object(self) -> str:
        """Return a name that nobody has."""
        names = self._taken | self.page.signs.keys()
        return next(name for k in range(1, len(names) + 2) if (name := f"{_FIRST}{k:03d}") not in names)

    def mark(self, marks: Mapping[Where, Mark], by: str, codes: str = "") -> None:
        """Put marks, in place of those of the same kind of the same object in the same picture."""
        new = {where.object for where in marks} - self.page.signs.keys()
        signs = {**self.page.signs, **{name: Sign(codes, by) for name in new}}
        self._turn(Page(signs, {**self.page.marks, **marks}))

    def name(self, sign: str, codes: str) -> None:
        """Say what stands on a pole."""
        self._turn(
            replace(self.page, signs={**self.page.signs, sign: replace(self.page.signs[sign], codes=codes)})
        )

    def remove(self, wheres: Iterable[Where]) -> None:
        """Take marks away; an object without any is gone."""
        gone = set(wheres)
        marks = {where: mark for where, mark in self.page.marks.items() if where not in gone}
        left = {where.object for where in marks}
        self._turn(Page({name: sign for name, sign in self.page.signs.items() if name in left}, marks))

    def undo(self) -> None:
        """Go back by one change, if there was one."""
        if self._before:
            self.page = self._before.pop()

    def at(self) -> tuple[Page, tuple[Page, ...]]:
        """Return all that :meth:`back_to` needs."""
        return self.page, tuple(self._before)

    def back_to(self, kept: tuple[Page, tuple[Page, ...]]) -> None:
        """Be as before, as what came since could not be kept."""
        self.page, self._before = kept[0], list(kept[1])

    def _turn(self, page: Page) -> None:
        self._before = [*self._before[-_MOST_UNDONE:], self.page]
        self.page = page
