"""What a match finds that the one before it did not: new findings, other verdicts, findings that are gone."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import sqlalchemy as sa

from twin.matching.reading import rows_of_drives
from twin.store import schema
from twin.store.kinds import QUIET, Verdict
from twin.store.records import Finding
from twin.store.store import Row, Snapshot

FACT = "match_news"
"""Key of the news of the last match; there is none after the first."""


@dataclass(frozen=True, slots=True)
class OtherVerdict:
    """A sign of which this match says something else than the one before.

    Attributes
    ----------
    change_id, verdict : str, Verdict
        Of the finding now.
    before_id, before : str, Verdict
        Of that before.
    """

    change_id: str
    verdict: Verdict
    before_id: str
    before: Verdict


@dataclass(frozen=True, slots=True)
class Gone:
    """A finding of the match before that has no successor, as its drive or its sign in NVDB is not there."""

    change_id: str
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class News:
    """What differs from the match before; what asked nobody to decide, then and now, is not news.

    Attributes
    ----------
    since : str
        When the match before was, UTC.
    new : tuple of str
        Change ids of signs that the match before did not name at all.
    changed : tuple of OtherVerdict
    gone : tuple of Gone
    """

    since: str
    new: tuple[str, ...] = ()
    changed: tuple[OtherVerdict, ...] = ()
    gone: tuple[Gone, ...] = ()

    @property
    def change_ids(self) -> frozenset[str]:
        """Findings of this match that are new or have another verdict, and ask for a decision."""
        changed = (one.change_id for one in self.changed if one.verdict not in QUIET)
        return frozenset((*self.new, *changed))

    def to_row(self) -> Row:
        """Return it as the fact that the store keeps."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Known:
    """By what findings of two matches are paired: the sign of NVDB that they name, and the pole seen."""

    change_id: str
    verdict: Verdict
    nvdb_type: int
    nvdb_id: int | None
    pole: str | None


def known_findings(view: Snapshot, only: Collection[str] | None = None) -> list[Known]:
    """Read the findings of the last match: all, or some of these ids."""
    change = schema.change.c
    pole = change.terms["pole"].as_string().label("pole")
    asked = sa.select(change.change_id, change.verdict, change.nvdb_type, change.nvdb_id, pole)
    rows = rows_of_drives(view, asked, change.change_id, only)
    found = (Known(**{**row, "verdict": Verdict(row["verdict"])}) for row in rows)
    return sorted(found, key=lambda one: one.change_id)


def known_of(finding: Finding) -> Known:
    """The same of a finding of this match."""
    return Known(
        finding.change_id, finding.verdict, finding.nvdb_type, finding.nvdb_id, finding.terms.get("pole")
    )


def news_of(since: str, before: Sequence[Known], now: Sequence[Known]) -> News:
    """Compare two matches.

    A finding is paired with that of the same id, else of the same object of NVDB, else of the same pole: a
    sign that NVDB has got meanwhile was ``new`` and is ``unchanged``.
    """
    old = {one.change_id: one for one in before}
    left = {one.change_id: one for one in now}
    pairs = [(old.pop(key), left.pop(key)) for key in list(left) if key in old]
    ways: tuple[Callable[[Known], Hashable], ...] = (_object, lambda one: (one.nvdb_type, one.pole), _pole)
    for key_of in ways:
        found = list(_paired(old.values(), left.values(), key_of))
        for was, one in found:
            del old[was.change_id], left[one.change_id]
        pairs += found
    changed = [
        OtherVerdict(one.change_id, one.verdict, was.change_id, was.verdict)
        for was, one in pairs
        if was.verdict != one.verdict and not {was.verdict, one.verdict} <= QUIET
    ]
    return News(
        since,
        new=tuple(one.change_id for one in left.values() if one.verdict not in QUIET),
        changed=tuple(sorted(changed, key=lambda one: one.change_id)),
        gone=tuple(Gone(one.change_id, one.verdict) for one in old.values() if one.verdict not in QUIET),
    )


def news_from(fact: Row | None) -> News | None:
    """Take the news of the last match from what the store keeps; None where there is none."""
    if fact is None:
        return None
    return News(
        fact["since"],
        new=tuple(fact["new"]),
        changed=tuple(
            OtherVerdict(one["change_id"], Verdict(one["verdict"]), one["before_id"], Verdict(one["before"]))
            for one in fact["changed"]
        ),
        gone=tuple(Gone(one["change_id"], Verdict(one["verdict"])) for one in fact["gone"]),
    )


def _object(one: Known) -> Hashable:
    return None if one.nvdb_id is None else (one.nvdb_type, one.nvdb_id)


def _pole(one: Known) -> Hashable:
    return one.pole


def _paired(
    before: Iterable[Known], now: Iterable[Known], key_of: Callable[[Known], Any]
) -> Iterator[tuple[Known, Known]]:
    """Pair those of one key; several of one key stay as many as they can be."""
    waiting: dict[Hashable, list[Known]] = {}
    for was in before:
        waiting.setdefault(key_of(was), []).append(was)
    for one in now:
        key = key_of(one)
        if key is None or (isinstance(key, tuple) and key[-1] is None):
            continue
        if waiting.get(key):
            yield waiting[key].pop(0), one
