"""Second opinions: what people say who do not see each other's answers, and how often they agree."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import sqlalchemy as sa

from twin.decisions.evidence import Ask, differences, present_evidence
from twin.decisions.log import OPINION, WITHDRAWN, Entry
from twin.store import schema


@dataclass(frozen=True, slots=True)
class Agreement:
    """How often people who answered blindly agree about findings of one verdict.

    Attributes
    ----------
    n : int
        Findings with the opinions of two people or more.
    n_agreed : int
        Of these, findings of which all say the same.
    """

    n: int
    n_agreed: int


def opinions_of(ask: Ask, only: Collection[str] | None = None) -> dict[str, tuple[Entry, ...]]:
    """Return the opinions that stand, by ``change_id``: each person's last, in the order given.

    An opinion that was withdrawn, or given on other evidence than the present, stands no longer.
    """
    log = schema.decision_log
    asked = sa.select(log).where(log.c.kind.in_((OPINION, WITHDRAWN))).order_by(log.c.id)
    entries = [
        Entry.from_row(row) for row in ask(asked if only is None else asked.where(log.c.change_id.in_(only)))
    ]
    withdrawn = {entry.undo_of for entry in entries if entry.kind == WITHDRAWN}
    standing: dict[str, dict[str, Entry]] = {}
    for entry in entries:
        if entry.kind == OPINION and entry.id not in withdrawn:
            of_people = standing.setdefault(entry.change_id, {})
            of_people.pop(entry.by, None)
            of_people[entry.by] = entry
    evidence = present_evidence(ask, tuple(standing)) if standing else {}
    found = {}
    for key, of_people in standing.items():
        now = evidence.get(key)
        kept = tuple(e for e in of_people.values() if now is not None and not differences(e.evidence, now))
        if kept:
            found[key] = kept
    return found


def agreeing(opinions: Sequence[Entry], mine: Entry) -> tuple[Entry, ...]:
    """Return the opinions of others that say the same."""
    return tuple(one for one in opinions if one.by != mine.by and one.decision == mine.decision)


def in_disagreement(opinions: Sequence[Entry]) -> bool:
    """Whether two people say different things."""
    return len({one.decision for one in opinions}) > 1


def agreement(opinions: Mapping[str, Sequence[Entry]]) -> dict[str, Agreement]:
    """Count by verdict how often people agree; verdicts without a second opinion are absent."""
    asked, agreed = Counter[str](), Counter[str]()
    for of_change in opinions.values():
        if len(of_change) > 1:
            verdict = of_change[0].evidence.verdict
            asked[verdict] += 1
            agreed[verdict] += not in_disagreement(of_change)
    return {verdict: Agreement(n, agreed[verdict]) for verdict, n in sorted(asked.items())}
