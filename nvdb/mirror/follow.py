"""Keep a mirror of Skiltpunkt and Skiltplate true: a backfill once, then the changes only.

The store belongs to somebody else: it implements :class:`~nvdb.mirror.states.MirrorStore`. What readers see
is always a whole mirror. A backfill is kept aside, page by page with its cursor, so that it can be killed and
resumed at any instant; the changes since its beginning are worked in there too, and then it becomes visible
in one step. A round of changes becomes visible in one step too.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Final

from nvdb import datakatalog
from nvdb.area import Area
from nvdb.errors import NvdbError
from nvdb.mirror.prefetch import one_ahead
from nvdb.mirror.source import FeedTooOldError, FetchResult, Source, SourcePage, Unknown, batches
from nvdb.mirror.states import Applied, Backfill, Following, Ids, MirrorStore

log = logging.getLogger(__name__)

SKILT_TYPES: Final = (datakatalog.SKILTPUNKT, datakatalog.SKILTPLATE)
_NAME: Final = {datakatalog.SKILTPUNKT: "Skiltpunkt", datakatalog.SKILTPLATE: "Skiltplate"}
MAX_LISTED: Final = 100
"""Problems listed in full; the rest is counted."""
MAX_DELETED_SHARE: Final = 0.05
"""A sync that would take more than this share of the mirror away is refused unless confirmed."""
FEW_DELETED: Final = 20
"""So many deletions are not suspicious, unless they are half of the mirror."""
MIN_RECEIVED_SHARE: Final = 0.95
"""A backfill that brings less than this share of what the API counts is not a mirror of it."""


class MassDeletionError(NvdbError):
    """A sync that would delete more of the mirror than a set share; the mirror is unchanged."""


class ShortBackfillError(NvdbError):
    """A backfill that brought far fewer objects than the API counts; the mirror is unchanged."""


@dataclass(frozen=True, slots=True)
class SyncProgress:
    """How far a sync has come: what it does, how many objects, and of how many (None: not known)."""

    what: str
    done: int
    expected: int | None


@dataclass(frozen=True, slots=True)
class SyncReport:
    """What a sync did.

    Attributes
    ----------
    area, source, url : str
    mode : str
        ``backfill``, ``resumed`` or ``changes``.
    started_at, finished_at : datetime
        UTC.
    received : int
        Objects fetched.
    n_events : int
        Events of the change feed.
    expected : dict
        Type → the API's own count; None where it gave none or was not asked (``changes``).
    applied : Applied
    n_problems : int
        Objects and values that could not be used.
    problems : tuple of str
        The first 100 of them, one sentence each.
    unknown : dict
        (property id, enum id or None) → how often: not in the datakatalog at hand.
    """

    area: str
    source: str
    url: str
    mode: str
    started_at: datetime
    finished_at: datetime
    received: int
    n_events: int
    expected: dict[int, int | None]
    applied: Applied
    n_problems: int
    problems: tuple[str, ...]
    unknown: dict[Unknown, int]


Progress = Callable[[SyncProgress], None]


@dataclass(slots=True)
class _Notes:
    """Running numbers of a sync."""

    progress: Progress | None
    today: str
    received: int = 0
    n_events: int = 0
    n_problems: int = 0
    problems: list[str] = field(default_factory=list)
    unknown: Counter[Unknown] = field(default_factory=Counter)
    expected: dict[int, int | None] = field(default_factory=dict)

    def tell(self, what: str, done: int, expected: int | None) -> None:
        if self.progress is not None:
            self.progress(SyncProgress(what, done, expected))

    def restart(self) -> None:
        """Forget what was read of pages that will be read again."""
        self.received = self.n_events = self.n_problems = 0
        self.problems.clear()
        self.unknown.clear()

    def note(self, problem: str) -> None:
        self.n_problems += 1
        if len(self.problems) < MAX_LISTED:
            self.problems.append(problem)

    def read(self, got: SourcePage | FetchResult) -> None:
        for problem in got.problems:
            self.note(problem)
        self.unknown.update(got.unknown)
        for skilt in got.objects:
            for problem in skilt.problems:
                self.note(f"Vegobjekt {skilt.nvdb_id}: {problem}.")


def sync(
    source: Source,
    store: MirrorStore,
    area: Area,
    *,
    fresh: bool = False,
    confirm_deletions: bool = False,
    max_deleted_share: float = MAX_DELETED_SHARE,
    progress: Progress | None = None,
    clock: Callable[[], datetime] = lambda: datetime.now(UTC),
) -> SyncReport:
    """Bring the mirror up to date: by a backfill if there is none, else by its changes.

    Parameters
    ----------
    source : Source
        Les V4 or Uberiket.
    store : MirrorStore
    area : Area
        Of another area than the mirror's a new mirror is made, however much of the old one goes.
    fresh : bool
        Backfill although the mirror could follow its changes. An interrupted backfill is resumed.
    confirm_deletions : bool
        Whether more than `max_deleted_share` of the mirror may go.
    progress : callable, optional
    clock : callable
        Now, with a time zone: tells which objects have ended.

    Returns
    -------
    SyncReport

    Raises
    ------
    MassDeletionError
        Too much would go; the visible mirror is unchanged.
    ShortBackfillError
        Far fewer objects came than the API counts; the visible mirror is unchanged.
    NvdbError
        The API; the visible mirror is unchanged, and what an interrupted backfill has is kept.

    Notes
    -----
    The feed's position is noted before the first page, and the changes since then are worked in after the
    last: a change during the backfill is seen twice rather than never. A feed that no longer reaches back to
    the mirror's position (Les V4 keeps 30 days) leads to a fresh backfill, beside the old mirror.
    """
    source.check(area)
    started_at = clock()
    notes = _Notes(progress, started_at.astimezone(UTC).date().isoformat())
    known = store.following()
    another = known is not None and known.area != area.text()
    guard = _Guard(store, 1.0 if confirm_deletions or another else max_deleted_share)
    mode, applied = "changes", None
    ours = known is not None and (known.source, known.area) == (identity(source), area.text())
    if known is not None and ours and not fresh and store.backfill() is None:
        try:
            applied = _follow(source, store, area, known, guard, notes)
        except FeedTooOldError as error:
            log.info("%s Fetching everything anew; the old mirror stays until that is done.", error)
    if applied is None:
        mode, applied = _fill(source, store, area, guard, notes)
    return SyncReport(
        area=area.text(),
        source=source.name,
        url=source.url,
        mode=mode,
        started_at=started_at,
        finished_at=clock(),
        received=notes.received,
        n_events=notes.n_events,
        expected=notes.expected,
        applied=applied,
        n_problems=notes.n_problems,
        problems=tuple(notes.problems),
        unknown=dict(notes.unknown),
    )


def _fill(
    source: Source, store: MirrorStore, area: Area, guard: _Guard, notes: _Notes
) -> tuple[str, Applied]:
    """Fetch everything beside the visible mirror, bring it up to date there, and publish it."""
    begun, following = store.backfill(), None
    if begun is not None and can_resume(source, area, begun):
        mode, following = "resumed", _fetch_all(source, store, area, begun, notes)
        if any(lacking > 0 for lacking in _lacking(store, following, notes).values()):
            log.info("The resumed backfill lacks objects, as if their order had changed: fetching all anew.")
            following = None
    if following is None:
        mode, begun = "backfill", Backfill(identity(source), area.text(), source.head())
        store.begin_backfill(begun)
        notes.restart()
        following = _fetch_all(source, store, area, begun, notes)
    try:
        _check_whole(source, store, area, following, notes)
        store.keep_visible(_known_unread(store, following))
        guard.check_published()
    except (MassDeletionError, ShortBackfillError):
        # Its cursors are at the end: taken up again it would be refused again, whatever the API says by then.
        store.begin_changes()
        raise
    return mode, store.publish(following)


def identity(source: Source) -> str:
    """Name and address: a position or cursor of the test API means nothing to the real one."""
    return f"{source.name} at {source.url}"


def can_resume(source: Source, area: Area, begun: Backfill) -> bool:
    """Whether an interrupted backfill is of this source and area, and its changes since can still be had."""
    same = (begun.source, begun.area) == (identity(source), area.text())
    return same and reaches(source, begun.position)


def reaches(source: Source, position: str) -> bool:
    """Whether the change feed still reaches back to a position; asks for its first page."""
    try:
        next(iter(source.changes(SKILT_TYPES, position)), None)
    except FeedTooOldError:
        return False
    return True


def _fetch_all(source: Source, store: MirrorStore, area: Area, begun: Backfill, notes: _Notes) -> Following:
    """Keep all pages aside, then what changed since the backfill began; return where that leads."""
    for type_id in SKILT_TYPES:
        _fetch_pages(source, store, area, type_id, begun.cursors.get(type_id), notes)
    kept = store.backfill() or begun
    since = Following(kept.source, kept.area, kept.position, kept.unread)
    following, gone = _collect_changes(source, store, area, since, notes)
    store.drop_aside(gone)
    return following


def _fetch_pages(
    source: Source, store: MirrorStore, area: Area, type_id: int, start: str | None, notes: _Notes
) -> None:
    name = _NAME[type_id]
    notes.expected[type_id] = expected = source.count(type_id, area)
    done = store.count_aside(type_id) if start is not None else 0
    notes.tell(name, done, expected)
    for page in one_ahead(source.pages(type_id, area, start)):
        store.save_page(page)
        notes.read(page)
        notes.received += page.received
        done += len(page.objects)
        notes.tell(name, done, expected)


def _lacking(store: MirrorStore, following: Following, notes: _Notes) -> dict[int, int]:
    """How many objects of each type the API counts that did not come; below 0 if more came."""
    return {
        type_id: expected - store.count_aside(type_id) - len(following.unread.get(type_id, ()))
        for type_id, expected in notes.expected.items()
        if expected is not None
    }


def _check_whole(source: Source, store: MirrorStore, area: Area, following: Following, notes: _Notes) -> None:
    """Refuse a backfill that lacks much of what the API counts, and note one that differs a little."""
    for type_id, differs in _lacking(store, following, notes).items():
        if differs:  # perhaps only by what changed meanwhile
            notes.expected[type_id] = source.count(type_id, area)
    for type_id, lacking in _lacking(store, following, notes).items():
        expected, name = notes.expected[type_id] or 0, _NAME[type_id]
        sent = expected - lacking
        if sent < MIN_RECEIVED_SHARE * expected:
            msg = (
                f"{source.url} counts {expected:,} {name} and sent {sent:,}: the mirror stays as it was; run "
                "the sync again, and report it to NVDB if that does not help."
            )
            raise ShortBackfillError(msg)
        if lacking:
            notes.note(
                f"The API counts {expected:,} {name} and sent {sent:,}: if they should agree, "
                "fetch everything anew."
            )


def _known_unread(store: MirrorStore, following: Following) -> Ids:
    """Unreadable objects whose last readable state is in a visible mirror of the same kind: it stays."""
    known = store.following()
    same = known is not None and (known.source, known.area) == (following.source, following.area)
    return following.unread if same else {}


def _follow(
    source: Source, store: MirrorStore, area: Area, since: Following, guard: _Guard, notes: _Notes
) -> Applied:
    """Apply all changes since a position in one step."""
    store.begin_changes()
    ended = {type_id: store.ended(type_id, notes.today) for type_id in SKILT_TYPES}
    again = {type_id: ids | since.unread.get(type_id, frozenset()) for type_id, ids in ended.items()}
    following, gone = _collect_changes(source, store, area, replace(since, unread=again), notes)
    guard.check_deleted(gone)
    return store.apply(following, gone)


def _collect_changes(
    source: Source, store: MirrorStore, area: Area, since: Following, notes: _Notes
) -> tuple[Following, dict[int, frozenset[int]]]:
    """Collect the ids of every event, fetch these objects as they are now, and keep them aside.

    Returns
    -------
    following, gone
        The position after the last event, and the ids that are no more.
    """
    wanted = {type_id: set(since.unread.get(type_id, ())) for type_id in SKILT_TYPES}
    position = since.position
    for page in source.changes(SKILT_TYPES, since.position):
        for type_id, ids in page.changed.items():
            wanted[type_id] |= ids
        position = page.next_position
        notes.n_events += page.n_events
        notes.tell("events", notes.n_events, None)
    gone: dict[int, frozenset[int]] = {}
    unread: dict[int, frozenset[int]] = {}
    for type_id in SKILT_TYPES:
        found = _fetch_changed(source, store, area, type_id, wanted[type_id], notes)
        gone[type_id], unread[type_id] = found
    return replace(since, position=position, unread=unread), gone


def _fetch_changed(
    source: Source, store: MirrorStore, area: Area, type_id: int, ids: set[int], notes: _Notes
) -> tuple[frozenset[int], frozenset[int]]:
    """Fetch changed objects, keep them aside, and return the ids that are gone and those unreadable."""
    missing: set[int] = set()
    unreadable: set[int] = set()
    done = 0
    for batch in batches(ids):
        result = source.fetch(type_id, batch, area)
        store.save_changes(result)
        notes.read(result)
        notes.received += len(result.objects)
        missing |= result.missing
        unreadable |= result.unreadable
        done += len(batch)
        notes.tell(f"changed {_NAME[type_id]}", done, len(ids))
    return frozenset(missing), frozenset(unreadable)


@dataclass(frozen=True, slots=True)
class _Guard:
    """Refuses what would empty the mirror: an API without objects looks like a country without signs."""

    store: MirrorStore
    share: float

    def check_deleted(self, gone: Ids) -> None:
        for type_id, ids in gone.items():
            # Of the ids that are gone most were never mirrored: the feed knows no area.
            self._check(type_id, self.store.count(type_id), self.store.count(type_id, ids))

    def check_published(self) -> None:
        for type_id in SKILT_TYPES:
            before = self.store.count(type_id)
            self._check(type_id, before, before - self.store.count_aside(type_id))

    def _check(self, type_id: int, before: int, deleted: int) -> None:
        if deleted > max(min(FEW_DELETED, before / 2), self.share * before):
            name = _NAME[type_id]
            msg = (
                f"This sync would delete {deleted:,} of {before:,} {name} from the mirror, more than "
                f"{self.share:.0%}: check the source, or confirm the deletions."
            )
            raise MassDeletionError(msg)
