"""One finding of the last match with the estimates that it rests on."""

from __future__ import annotations

from dataclasses import dataclass

import sqlalchemy as sa

from twin.decisions.findings import FindingStatus, latest_findings
from twin.reports.finding_list import finding_id
from twin.store import schema
from twin.store.schema import METHODS
from twin.store.store import Snapshot, Store


@dataclass(frozen=True, slots=True)
class FindingShown:
    """A finding, and what was measured of its sign.

    Attributes
    ----------
    change : FindingStatus
    estimates : tuple of str
        Ids of the estimates of its pole by the method that was matched, the one of most sightings first;
        empty of a sign that was not seen.
    """

    change: FindingStatus
    estimates: tuple[str, ...]


def finding_shown(store: Store, which: str) -> FindingShown | None:
    """Return the finding that is meant by an id or its first six digits; None where there is none.

    Raises
    ------
    ConfigError
        Several findings begin so.
    """
    with store.snapshot() as view:
        meant = finding_id(view, which)
        if meant is None:
            return None
        (change,) = latest_findings(view.rows, {meant})
        return FindingShown(change, _estimates(view, change))


def _estimates(view: Snapshot, change: FindingStatus) -> tuple[str, ...]:
    pole = change.finding.terms.get("pole")
    if pole is None:
        return ()
    key, estimate = schema.pole_key.c, schema.estimate.c
    members = sa.select(key.member).where(key.pole == pole)
    asked = sa.select(estimate.estimate_id, estimate.method).where(
        (estimate.drive_id + ":" + estimate.object).in_(members)
    )
    rows = view.rows(asked.order_by(estimate.n_sightings.desc(), estimate.estimate_id))
    matched = (view.fact("last_match") or {}).get("method", METHODS[0])
    return tuple(row["estimate_id"] for row in rows if row["method"] == matched)
