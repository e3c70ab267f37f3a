"""How soon signs are taken down, by class: from what NVDB has closed since the mirror began.

What NVDB closed is a sign that was taken down, unless it has at once another like it in the same place: then
it was registered anew. How old a sign is NVDB does not tell (a start date is that of a version), so the
survival time is exponential: the one law by which age does not matter. Its rate is the number of signs closed
over the years that all were mirrored. A class with few closed signs is drawn towards the rate of all, and
that towards the stated default, as a gamma prior does.
"""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import sqlalchemy as sa

from nvdb.datakatalog import SKILTPUNKT
from twin.store import schema
from twin.store.store import Row, Snapshot

_DAYS_PER_YEAR = 365.25
_SAME_PLACE_M = 3.0
_ANEW_DAYS = 60.0
"""So soon before or after a sign was closed came the one that takes its place."""
PRIOR_EVENTS = 5.0
"""Closed signs that the rate which a class is drawn towards counts for."""
OF_NO_CLASS = ""


@dataclass(frozen=True, slots=True)
class ClassLife:
    """What the mirror tells of one class, and what is believed.

    Attributes
    ----------
    closed : int
        Signs that NVDB has closed.
    years : float
        Years that signs of the class were mirrored, added up.
    per_year : float
        Share that is taken down in a year.
    """

    closed: int
    years: float
    per_year: float


@dataclass(frozen=True, slots=True)
class Lifetimes:
    """Rates at which signs are taken down.

    Attributes
    ----------
    every : ClassLife
        Of all signs together.
    classes : mapping of class to ClassLife
        By the first digit of the upper plate's code: 3 are the 300s.
    default : float
        The stated rate, which stands alone where nothing was closed.
    """

    every: ClassLife
    classes: Mapping[str, ClassLife] = field(default_factory=dict)
    default: float = 0.02

    def per_year(self, sign_class: str) -> float:
        """Return the rate of a class; of one that the mirror has never had, that of all."""
        return self.classes.get(sign_class, self.every).per_year


def sign_class(codes: Sequence[str]) -> str:
    """Return the class of a pole by its upper plate: 3 of 362.50 and of U362; "" where no code is known."""
    return next((digit for code in codes[:1] for digit in code if digit.isdigit()), OF_NO_CLASS)


def fitted(counts: Mapping[str, tuple[int, float]], default: float) -> Lifetimes:
    """Fit the rates of classes from their closed signs and years.

    Parameters
    ----------
    counts : mapping of class to (closed, years)
    default : float
        Rate that is stated for all, per year.
    """
    closed, years = sum(n for n, _ in counts.values()), sum(t for _, t in counts.values())
    every = ClassLife(closed, years, _posterior(closed, years, default))
    classes = {name: ClassLife(n, t, _posterior(n, t, every.per_year)) for name, (n, t) in counts.items()}
    return Lifetimes(every, classes, default)


def _posterior(closed: int, years: float, prior: float) -> float:
    """Mean of the gamma posterior whose prior has the mean `prior` and counts as `PRIOR_EVENTS`."""
    return (closed + PRIOR_EVENTS) / (years + PRIOR_EVENTS / prior) if prior > 0 else 0.0


def lifetimes_of(view: Snapshot, default: float) -> Lifetimes:
    """Learn the rates from the history that the mirror keeps of this area."""
    mirror = view.fact("mirror") or {}
    if not mirror.get("since"):
        return fitted({}, default)
    began, now = _day(mirror["since"]), _day(mirror["synced_at"])
    tables = schema.MIRROR[SKILTPUNKT]
    point = tables.visible.c
    names = ("nvdb_id", "east_m", "north_m", "start_date", "end_date", "synced_at", "plate_ids")
    standing = {row["nvdb_id"]: row for row in view.rows(sa.select(*(point[name] for name in names)))}
    older = tables.history.c
    asked = sa.select(*(older[name] for name in names), older.seen_until)
    states: dict[int, list[Row]] = {}
    # What another area's mirror had is no event of this one: it went as this one was published.
    for row in view.rows(asked.where(older.seen_until > mirror["since"]).order_by(older.seen_until)):
        states.setdefault(row["nvdb_id"], []).append(row)
    gone = {nvdb_id: rows[-1] for nvdb_id, rows in states.items() if nvdb_id not in standing}
    codes = _codes(view)
    first: dict[int, str] = {nvdb_id: rows[0]["synced_at"] for nvdb_id, rows in states.items()}
    first |= {nvdb_id: row["synced_at"] for nvdb_id, row in standing.items() if nvdb_id not in first}
    came = {nvdb_id: max(began, _day(first[nvdb_id])) for nvdb_id in standing}
    anew = _registered_anew(gone, standing, came, codes)
    counts: dict[str, tuple[int, float]] = {}
    for nvdb_id, row in [*standing.items(), *gone.items()]:
        is_gone = nvdb_id in gone
        ended = _ended(row) if is_gone else now
        begun = max(began, _day(first[nvdb_id]))
        years = max(ended - begun, 0.0) / _DAYS_PER_YEAR
        key = sign_class(_codes_of(row, codes))
        n, total = counts.get(key, (0, 0.0))
        counts[key] = n + (is_gone and nvdb_id not in anew), total + years
    return fitted(counts, default)


def _registered_anew(
    gone: Mapping[int, Row], standing: Mapping[int, Row], came: Mapping[int, float], codes: Mapping[int, str]
) -> set[int]:
    """Objects that were closed as another came at the same place with a code in common."""
    from scipy.spatial import cKDTree

    placed = [nvdb_id for nvdb_id, row in gone.items() if row["east_m"] is not None]
    fresh = [nvdb_id for nvdb_id, row in standing.items() if row["east_m"] is not None]
    if not placed or not fresh:
        return set()
    tree = cKDTree([(standing[one]["east_m"], standing[one]["north_m"]) for one in fresh])
    near = tree.query_ball_point(
        [(gone[one]["east_m"], gone[one]["north_m"]) for one in placed], _SAME_PLACE_M
    )
    return {
        old
        for old, others in zip(placed, near, strict=True)
        if any(
            abs(came[fresh[k]] - _ended(gone[old])) <= _ANEW_DAYS
            and set(_codes_of(gone[old], codes)) & set(_codes_of(standing[fresh[k]], codes))
            for k in others
        )
    }


def _codes(view: Snapshot) -> dict[int, str]:
    """Sign code of each plate, now or when it was last there."""
    tables = schema.MIRROR[96]
    known: dict[int, str] = {}
    for table in (tables.history, tables.visible):
        rows = view.columns(sa.select(table.c.nvdb_id, table.c.skiltnummer))
        known |= {k: code for k, code in zip(rows["nvdb_id"], rows["skiltnummer"], strict=True) if code}
    return known


def _codes_of(row: Row, codes: Mapping[int, str]) -> list[str]:
    return [codes[plate] for plate in row["plate_ids"] if plate in codes]


def _ended(row: Row) -> float:
    """Day on which a closed object ended: by NVDB's own date, else when we learnt of it."""
    known = _day(row["seen_until"])
    return min(known, _day(row["end_date"])) if row["end_date"] else known


def _day(text: str) -> float:
    """Day of an ISO date or time, counted from any."""
    return float(dt.date.fromisoformat(text[:10]).toordinal())
