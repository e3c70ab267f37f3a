"""Where a mirror gets its objects and their changes: one interface, two APIs.

A mirror notes :meth:`Source.head`, pages through everything (:meth:`Source.pages`), and from then on follows
:meth:`Source.changes` from the noted position and fetches what changed by id. The order matters: a position
noted *before* the first page makes sure that a change during the backfill is seen twice rather than never.

:class:`~nvdb.mirror.les_v4.LesV4Source` and :class:`~nvdb.mirror.uberiket.UberiketSource` are the two. What
they give for the same object differs only where the APIs do: see :mod:`nvdb.mirror.uberiket`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final, Protocol

from nvdb.area import Area
from nvdb.client.client import NvdbClient, Params
from nvdb.datakatalog.ids import SKILTPLATE, SKILTPUNKT
from nvdb.datakatalog.katalog import Datakatalog, snapshot
from nvdb.errors import BodyError, HttpStatusError, NvdbError, RequestError, SchemaError
from nvdb.objects.skilt import Skiltplate, Skiltpunkt

FETCH_BATCH: Final = 100
"""Ids in one question, as Statens vegvesen's own mirrors ask."""

MAX_PAGE: Final = 1000
"""Most objects or events on one page, in both APIs."""

FEW_UNREADABLE: Final = 3
"""From so many objects on, a page of which none can be read means a changed API: a last page may hold just
the one object that has gone bad."""

Unknown = tuple[int, int | None]
"""A property id, or a property id and an enum id, that the datakatalog at hand does not know."""

Raw = dict[str, Any]


class FeedTooOldError(NvdbError):
    """The change feed no longer reaches back to the mirror's position: only a fresh backfill helps."""


@dataclass(frozen=True, slots=True)
class SourcePage:
    """One page of a backfill.

    Attributes
    ----------
    type_id : int
    objects : tuple of Skiltpunkt or Skiltplate
        All that could be read and that lie in the area.
    problems : tuple of str
        One sentence for each object that could not be read or placed. Values that could not be used are
        named in the objects' own ``problems``.
    next_cursor : str
        ``start`` to go on from, also after the last page (the API then answers with an empty page): a mirror
        that is killed before it notes the end loses nothing and begins nothing again.
    received : int
        Objects on the page, readable or not; comparable with :meth:`Source.count`. Of Uberiket's versions
        those that are closed, and objects outside the area, are not counted.
    unknown : mapping of (property id, enum id or None) → how often
        Ids that the datakatalog at hand does not know; the values are kept.
    unreadable : frozenset of int
        Ids of objects that came in a form that cannot be read.
    """

    type_id: int
    objects: tuple[Skiltpunkt | Skiltplate, ...]
    problems: tuple[str, ...]
    next_cursor: str
    received: int
    unknown: Mapping[Unknown, int] = field(default_factory=dict)
    unreadable: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class ChangePage:
    """One page of the change feed.

    Attributes
    ----------
    changed : mapping of vegobjekttype → ids
        Objects that were created, changed, removed or segmented anew; which of these is learnt by asking
        for them.
    next_position : str
        Where to go on once these are dealt with.
    n_events : int
    """

    changed: Mapping[int, frozenset[int]]
    next_position: str
    n_events: int


@dataclass(frozen=True, slots=True)
class FetchResult:
    """Objects asked for by id.

    Attributes
    ----------
    objects : tuple of Skiltpunkt or Skiltplate
    missing : frozenset of int
        Ids that did not come back, or lie outside the area now: to be taken out of the mirror.
    unreadable : frozenset of int
        Ids that came back in a form that cannot be read: neither to be replaced nor taken out.
    problems : tuple of str
    unknown : mapping
        See :class:`SourcePage`.
    """

    objects: tuple[Skiltpunkt | Skiltplate, ...]
    missing: frozenset[int]
    unreadable: frozenset[int] = frozenset()
    problems: tuple[str, ...] = ()
    unknown: Mapping[Unknown, int] = field(default_factory=dict)


class Source(Protocol):
    """What a mirror needs of an API.

    Every method may raise :class:`~nvdb.errors.TransportError` and :class:`~nvdb.errors.SchemaError`, and
    those that take an area what :meth:`check` raises.
    """

    @property
    def name(self) -> str:
        """``les-v4`` or ``uberiket``: positions and cursors of one mean nothing to the other."""

    @property
    def url(self) -> str:
        """Base URL of the API."""

    def check(self, area: Area) -> None:
        """Raise AreaError if this source cannot select `area`."""

    def first_request(self, type_id: int, area: Area) -> tuple[str, dict[str, str | int]]:
        """Path and parameters of a backfill's first question."""

    def head(self) -> str:
        """Position in the change feed now; to be noted before a backfill."""

    def count(self, type_id: int, area: Area) -> int | None:
        """The API's own count of objects; None if it has none to give."""

    def pages(self, type_id: int, area: Area, start: str | None = None) -> Iterator[SourcePage]:
        """Yield pages with objects, from a cursor of an earlier page or from the beginning."""

    def changes(self, type_ids: Sequence[int], since: str) -> Iterator[ChangePage]:
        """Yield what changed after a position; FeedTooOldError if the feed no longer reaches it."""

    def fetch(self, type_id: int, ids: Sequence[int], area: Area) -> FetchResult:
        """Get objects as they are now, in batches of at most 100 ids."""


class ApiSource:
    """What the sources of both APIs are made of: a client, the size of a page, a datakatalog and a clock."""

    def __init__(
        self,
        client: NvdbClient,
        *,
        page_size: int = MAX_PAGE,
        katalog: Datakatalog | None = None,
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        if not 1 <= page_size <= MAX_PAGE:
            msg = f"A page of {page_size} objects cannot be asked for: take 1 to {MAX_PAGE}."
            raise RequestError(msg)
        self._client = client
        self._page_size = page_size
        self._katalog = katalog or snapshot()
        self._clock = clock
        self._known: set[Unknown] = set()
        """Properties and enum ids that the datakatalog has been seen to know: a page repeats them."""

    @property
    def url(self) -> str:
        """Base URL of the API."""
        return self._client.api_url

    def _counted(self, type_id: int, params: Params) -> int | None:
        """Ask API Les V4's ``statistikk``; None where it has no count to give."""
        try:
            answer: Any = self._client.get_json(f"/vegobjekter/{type_id}/statistikk", params)
        except (HttpStatusError, BodyError):
            return None
        number = answer.get("antall") if isinstance(answer, dict) else None
        return number if isinstance(number, int) and not isinstance(number, bool) and number >= 0 else None


@dataclass(slots=True)
class ReadObjects:
    """What has been read of some objects so far; :meth:`page` and :meth:`result` freeze it."""

    objects: list[Skiltpunkt | Skiltplate] = field(default_factory=list)
    unreadable: set[int] = field(default_factory=set)
    problems: list[str] = field(default_factory=list)
    unknown: Counter[Unknown] = field(default_factory=Counter)

    def refuse(self, raw: Mapping[str, Any], error: SchemaError) -> None:
        """Note an object that breaks the documented form."""
        self.problems.append(str(error))
        object_id = raw.get("id")
        if isinstance(object_id, int):
            self.unreadable.add(object_id)

    def check_any(self, type_id: int) -> None:
        """Raise if nothing at all could be read: then the API has changed, and not one object gone bad."""
        if len(self.unreadable) >= FEW_UNREADABLE and not self.objects:
            why = self.problems[0]
            msg = f"No object of a page of type {type_id} can be read ({why}): update this program."
            raise SchemaError(msg)

    def page(self, type_id: int, next_cursor: str, received: int) -> SourcePage:
        """Freeze as a page."""
        return SourcePage(
            type_id,
            tuple(self.objects),
            tuple(self.problems),
            next_cursor,
            received,
            dict(self.unknown),
            frozenset(self.unreadable),
        )

    def result(self, asked: Iterable[int]) -> FetchResult:
        """Freeze as the answer for the ids that were asked for."""
        found = {skilt.nvdb_id for skilt in self.objects}
        return FetchResult(
            tuple(self.objects),
            frozenset(asked) - found - self.unreadable,
            frozenset(self.unreadable - found),
            tuple(self.problems),
            dict(self.unknown),
        )


def batches(ids: Iterable[int]) -> Iterator[list[int]]:
    """Cut ids into sorted batches of at most `FETCH_BATCH`, each id once."""
    wanted = sorted(set(ids))
    for start in range(0, len(wanted), FETCH_BATCH):
        yield wanted[start : start + FETCH_BATCH]


def sign_types(type_ids: Iterable[int]) -> list[int]:
    """Return the types, sorted, each once; RequestError for any but 95 and 96."""
    kinds = sorted(set(type_ids))
    if not kinds or not set(kinds) <= {SKILTPUNKT, SKILTPLATE}:
        msg = f"Only the types {SKILTPUNKT} and {SKILTPLATE} can be mirrored, not {kinds}: ask for these."
        raise RequestError(msg)
    return kinds


def page_parts(body: object, names: Sequence[str], what: str) -> tuple[list[list[Raw]], str | None]:
    """Check a page's outer form.

    Parameters
    ----------
    body : object
        Parsed JSON.
    names : sequence of str
        Lists that the page must have.
    what : str
        What the page is of, for messages.

    Returns
    -------
    lists, next_cursor
        The lists in the order of `names`, and ``metadata.neste.start`` (None if absent).

    Raises
    ------
    SchemaError
        A list or ``metadata`` is missing, or is not what it should be.
    """

    def broken(clause: str) -> SchemaError:
        return SchemaError(f"A page of {what} {clause}: check the API URL, or update this program.")

    if not isinstance(body, dict):
        raise broken("is not an object")
    lists: list[list[Raw]] = []
    for name in names:
        items = body.get(name)
        if not isinstance(items, list):
            raise broken(f"has no list {name}")
        if not all(isinstance(item, dict) for item in items):
            raise broken(f"has something other than objects in {name}")
        lists.append(items)
    metadata = body.get("metadata")
    if not isinstance(metadata, dict):
        raise broken("has no metadata")
    neste = metadata.get("neste")
    cursor = neste.get("start") if isinstance(neste, dict) else None
    if isinstance(cursor, int) and not isinstance(cursor, bool):
        cursor = str(cursor)
    if cursor is not None and not isinstance(cursor, str):
        raise broken("has a metadata.neste.start that is not text")
    return lists, cursor
