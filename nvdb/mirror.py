"""Pull Skiltpunkt and Skiltplate of an area into a store.

The store belongs to somebody else: it implements :class:`MirrorStore`. Either a whole sync is kept, or the
mirror stays as it was. ``cursor`` and the cursors that travel with each page are the seam for syncs that
can be resumed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final, Protocol

from nvdb import datakatalog
from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.errors import BodyError, HttpStatusError, RequestError, SchemaError
from nvdb.paging import Page, iter_pages
from nvdb.skilt import Skiltplate, Skiltpunkt, skilt_from_les_v4

SKILT_TYPES: Final = (datakatalog.SKILTPUNKT, datakatalog.SKILTPLATE)
MAX_LISTED: Final = 100
"""Problems listed in full for each type; the rest is counted."""

_PARAMS: Final = {"inkluder": "alle", "srid": "5973"}


class MirrorStore(Protocol):
    """What a sync writes to.

    Calls come in this order: ``begin``; for each type ``cursor`` and then ``save_page`` for every page;
    and one of ``finish`` and ``abort``. Nothing may be visible to readers before ``finish`` returns, and
    after ``abort`` the mirror must be what it was before ``begin``.
    """

    def begin(self, area: Area, source: str) -> None:
        """Start a sync of `area` from the API at `source`."""

    def cursor(self, type_id: int) -> str | None:
        """Cursor to go on from for a type; None to start at its beginning."""

    def save_page(self, type_id: int, objects: Sequence[Skiltpunkt | Skiltplate], cursor: str | None) -> None:
        """Keep one page; `cursor` leads to the next. Of an object that comes twice the last counts."""

    def finish(self, report: SyncReport) -> None:
        """Make the sync visible."""

    def abort(self) -> None:
        """Forget everything since ``begin``."""


@dataclass(frozen=True, slots=True)
class SyncProgress:
    """How far a type has come; `expected` is None where the API does not say."""

    type_id: int
    received: int
    expected: int | None


@dataclass(frozen=True, slots=True)
class TypeReport:
    """What came of one type.

    Attributes
    ----------
    type_id : int
    expected : int or None
        The API's own count (``statistikk``); None if it gave none.
    received : int
        Objects in the pages.
    saved : int
        Objects handed to the store: all that could be read.
    without_own_geometry : int
        Of the saved: only placed on the road's centre line.
    without_position : int
        Of the saved: no usable point at all.
    retired : int
        Of the saved plates: with a ``U…`` code.
    n_problems : int
        Objects that could not be read, and values that could not be used.
    problems : tuple of str
        The first 100 of them, one sentence each.
    """

    type_id: int
    expected: int | None
    received: int
    saved: int
    without_own_geometry: int
    without_position: int
    retired: int
    n_problems: int
    problems: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class SyncReport:
    """What a sync did.

    `started_at` is taken before the first question: changes since then may be missing from the pages.
    """

    area: Area
    source: str
    started_at: datetime
    finished_at: datetime
    types: tuple[TypeReport, ...]


@dataclass(slots=True)
class _Count:
    """Running numbers of one type."""

    type_id: int
    expected: int | None
    received: int = 0
    saved: int = 0
    without_own_geometry: int = 0
    without_position: int = 0
    retired: int = 0
    n_problems: int = 0
    problems: list[str] = field(default_factory=list)

    def note(self, problem: str) -> None:
        self.n_problems += 1
        if len(self.problems) < MAX_LISTED:
            self.problems.append(problem)

    def add(self, skilt: Skiltpunkt | Skiltplate) -> None:
        self.saved += 1
        self.without_own_geometry += not skilt.own_geometry
        self.without_position += skilt.position is None
        self.retired += isinstance(skilt, Skiltplate) and skilt.retired
        for problem in skilt.problems:
            self.note(f"Vegobjekt {skilt.nvdb_id} (type {self.type_id}): {problem}.")

    def report(self) -> TypeReport:
        return TypeReport(
            self.type_id,
            self.expected,
            self.received,
            self.saved,
            self.without_own_geometry,
            self.without_position,
            self.retired,
            self.n_problems,
            tuple(self.problems),
        )


def sync(
    client: NvdbClient,
    store: MirrorStore,
    area: Area,
    types: Iterable[int] = SKILT_TYPES,
    page_size: int = 1000,
    progress: Callable[[SyncProgress], None] | None = None,
) -> SyncReport:
    """Pull every object of `types` in `area` into the store.

    Parameters
    ----------
    client : NvdbClient
    store : MirrorStore
        Gets ``begin``, pages, and ``finish``; on any exception (also Ctrl-C) ``abort``, and the exception
        goes on.
    area : Area
    types : iterable of int
        95 and 96.
    page_size : int
        1 to 1000, V4's limit; pages may still come shorter.
    progress : callable, optional
        Called once before and once after each page of each type.

    Returns
    -------
    SyncReport
        An object that breaks the documented form is left out, counted and named there.

    Raises
    ------
    TransportError
        The API could not be asked; see :mod:`nvdb.errors`.
    SchemaError
        A page that is not V4's, or of which no object can be read: the API has changed.
    """
    kinds = tuple(dict.fromkeys(types))
    if not kinds or not set(kinds) <= set(SKILT_TYPES):
        msg = f"Only the types {SKILT_TYPES} can be synced, not {kinds}."
        raise RequestError(msg)
    if not 1 <= page_size <= 1000:
        msg = f"A page of {page_size} objects cannot be asked for: take 1 to 1000."
        raise RequestError(msg)
    started_at = datetime.now(UTC)
    store.begin(area, client.api_url)
    try:
        reports = tuple(_sync_type(client, store, area, kind, page_size, progress) for kind in kinds)
        report = SyncReport(area, client.api_url, started_at, datetime.now(UTC), reports)
        store.finish(report)
    except BaseException:
        store.abort()
        raise
    return report


def _sync_type(
    client: NvdbClient,
    store: MirrorStore,
    area: Area,
    type_id: int,
    page_size: int,
    progress: Callable[[SyncProgress], None] | None,
) -> TypeReport:
    """Pull one type, page by page."""
    path = f"/vegobjekter/{type_id}"
    start = store.cursor(type_id)
    count = _Count(type_id, _expected(client, path, area))

    def tell() -> None:
        if progress is not None:
            progress(SyncProgress(type_id, count.received, count.expected))

    tell()
    params: dict[str, str | int] = {**_PARAMS, **area.params(), "antall": page_size}
    for page in iter_pages(client, path, params, start):
        store.save_page(type_id, _readable(page, count), page.next_cursor)
        tell()
    if start is None and count.expected is not None and count.received != count.expected:
        count.note(
            f"The API counts {count.expected} objects of type {type_id} and sent {count.received}: "
            "sync again if they should agree."
        )
    return count.report()


def _readable(page: Page, count: _Count) -> list[Skiltpunkt | Skiltplate]:
    """Objects of a page that can be read; the others are noted. None at all: the API has changed."""
    found: list[Skiltpunkt | Skiltplate] = []
    error: SchemaError | None = None
    for raw in page.objects:
        count.received += 1
        try:
            skilt = skilt_from_les_v4(raw, count.type_id)
        except SchemaError as refused:
            error = refused
            count.note(str(refused))
        else:
            count.add(skilt)
            found.append(skilt)
    if not found and error is not None:
        msg = f"No object of a page of type {count.type_id} can be read ({error}): update this program."
        raise SchemaError(msg) from error
    return found


def _expected(client: NvdbClient, path: str, area: Area) -> int | None:
    """The API's own count, for progress; None where it has none to give: a sync does not depend on it."""
    try:
        answer: Any = client.get_json(f"{path}/statistikk", area.params())
    except (HttpStatusError, BodyError):
        return None
    number = answer.get("antall") if isinstance(answer, dict) else None
    return number if isinstance(number, int) and not isinstance(number, bool) and number >= 0 else None
