"""What a mirror is made of while it is kept: its states, and what a store has to do with them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

from nvdb.mirror.source import FetchResult, SourcePage

Ids = Mapping[int, frozenset[int]]
"""Type → ids of vegobjekter."""


@dataclass(frozen=True, slots=True)
class Backfill:
    """A backfill that has begun and not ended.

    Attributes
    ----------
    source, area : str
        Name and address of the source, and ``Area.text()``: another one cannot go on where this one stopped.
    position : str
        The change feed's position before the first page.
    cursors : dict
        Type → cursor after the last page that was kept; a type that is absent has not begun.
    unread : mapping of type → ids
        Objects that came in a form that cannot be read.
    """

    source: str
    area: str
    position: str
    cursors: dict[int, str] = field(default_factory=dict)
    unread: Ids = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Following:
    """A whole mirror that follows the changes from a position of a source's feed.

    `unread` are the objects, by type, that could not be read when they last changed: the feed will not name
    them again, so every sync asks for them until they can be read.
    """

    source: str
    area: str
    position: str
    unread: Ids = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Applied:
    """What one visible step did to the mirror, by type: objects new, changed, gone, and there now."""

    created: dict[int, int]
    changed: dict[int, int]
    deleted: dict[int, int]
    total: dict[int, int]


class MirrorStore(Protocol):
    """What a sync writes to. Each method is one transaction: it is done wholly or not at all."""

    def following(self) -> Following | None:
        """The visible mirror, or None if there is none."""

    def backfill(self) -> Backfill | None:
        """A backfill that was interrupted, or None."""

    def count(self, type_id: int, ids: Iterable[int] | None = None) -> int:
        """Objects of a type in the visible mirror; only those with one of `ids`, if given."""

    def ended(self, type_id: int, day: str) -> frozenset[int]:
        """Ids in the visible mirror whose end date has come: no event tells that a day has come."""

    def begin_backfill(self, backfill: Backfill) -> None:
        """Forget whatever is kept aside and start to keep pages aside."""

    def save_page(self, page: SourcePage) -> None:
        """Keep a page and its cursor aside; of an object that comes twice, the last counts."""

    def count_aside(self, type_id: int) -> int:
        """Objects of a type that are kept aside."""

    def drop_aside(self, gone: Ids) -> None:
        """Take objects out of what is kept aside."""

    def keep_visible(self, ids: Ids) -> None:
        """Copy visible states aside, of objects that are not aside."""

    def publish(self, following: Following) -> Applied:
        """Make what is kept aside the visible mirror; what differs goes to the history."""

    def begin_changes(self) -> None:
        """Forget whatever is kept aside, a backfill included, and start to keep changed objects aside."""

    def save_changes(self, result: FetchResult) -> None:
        """Keep changed objects aside."""

    def apply(self, following: Following, deleted: Ids) -> Applied:
        """Bring what is kept aside into the visible mirror and take `deleted` out, into the history."""
