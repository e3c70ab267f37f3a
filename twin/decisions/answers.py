"""One answer at a time, as a page gives it: on what the person saw, once, and taken back one by one.

The log is that of :mod:`twin.decisions.record`. What is new here: the page says what its person saw, so that
an answer to a finding that has changed meanwhile is refused; each request has a key, so that one sent again
after a broken connection is not answered twice; and what one person answered in one session is taken back
without touching anybody else's.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass

import sqlalchemy as sa

from twin.decisions.evidence import Ask, Evidence, present_evidence
from twin.decisions.log import DECIDED, OPINION, Entry, all_entries, append, asking, last_entries
from twin.decisions.opinions import agreeing, opinions_of
from twin.decisions.record import check, is_left, take_back
from twin.decisions.temporary import settle_road_works, temporary_cause
from twin.errors import ConfigError, RefusedError
from twin.store import schema
from twin.store.kinds import QUIET, Decision, Verdict
from twin.store.store import Store, utc_now

ANSWERS = (Decision.ACCEPT, Decision.DISMISS, Decision.DEFER)
_AND = " and "


class SeenOtherwiseError(RefusedError):
    """The finding is no longer what the person saw; nothing was kept.

    Parameters
    ----------
    last : Entry or None
        What was decided since it was seen; None where its evidence has changed.
    """

    def __init__(self, last: Entry | None) -> None:
        since = "Its evidence has changed" if last is None else f"{last.by} has decided ({last.decision})"
        super().__init__(f"{since} since this finding was seen: look at it again, then answer.")
        self.last = last


@dataclass(frozen=True, slots=True)
class Author:
    """Who answers.

    Attributes
    ----------
    by : str
        The person's name.
    session : str
        In which answers are taken back together; not empty.
    request : str or None
        Key of this request; the same request sent again does nothing more.
    """

    by: str
    session: str
    request: str | None = None


@dataclass(frozen=True, slots=True)
class Answered:
    """What became of an answer.

    Attributes
    ----------
    change_id : str
    decision : Decision
        That holds now; after an opinion ``open``, unless it agrees with another's.
    entry_id : int
        Of the log.
    """

    change_id: str
    decision: Decision
    entry_id: int


def revision_seen(ask: Ask, change_id: str) -> str:
    """Say in short what is known and decided of a finding now, for :func:`answer`; "" if it is none."""
    evidence = present_evidence(ask, (change_id,)).get(change_id)
    return "" if evidence is None else _revision(evidence, last_entries(ask, (change_id,)).get(change_id))


def answer(
    store: Store,
    change_id: str,
    decision: str,
    author: Author,
    *,
    seen: str,
    reason: str = "",
    temporary: bool = False,
    blind: bool = False,
) -> Answered:
    """Keep one person's answer to one finding.

    Parameters
    ----------
    store : Store
        Matched, and neither synced nor ingested into since.
    change_id : str
        Whole.
    decision : str
        ``accept``, ``dismiss`` or ``defer``.
    author : Author
    seen : str
        Of :func:`revision_seen`, when the person was shown the finding.
    reason : str
        The person's comment.
    temporary : bool
        As :func:`twin.decisions.record.decide`.
    blind : bool
        Keep it as an opinion, which settles nothing until somebody else's agrees; then the finding is decided
        by both.

    Raises
    ------
    ConfigError
        The finding is not of the last match or asks nobody to decide; the decision is none; nobody is named.
    SeenOtherwiseError
        Its evidence has changed since it was shown, or somebody else has decided otherwise.
    StoreError, RefusedError
        As :meth:`twin.store.store.Store.matched`; the key was used for something else.
    """
    check(decision, author.by, temporary=temporary)
    if decision not in ANSWERS:
        raise ConfigError(f"{decision!r} is no answer: choose one of {', '.join(ANSWERS)}.")
    with store.transaction() as connection:
        ask = asking(connection)
        if (done := _done_before(ask, author)) is not None:
            return _answered(ask, change_id, done)
        store.view(connection).matched()
        evidence = present_evidence(ask, (change_id,)).get(change_id)
        if evidence is None or Verdict(evidence.verdict) in QUIET:
            raise ConfigError(f"The last match has no finding {change_id} that asks for a decision.")
        last = last_entries(ask, (change_id,)).get(change_id)
        _refuse_seen_otherwise(seen, evidence, last, decision, blind=blind)
        entry = Entry(
            change_id,
            Decision(decision),
            reason,
            author.by,
            utc_now(),
            evidence,
            OPINION if blind else DECIDED,
            cause=temporary_cause(ask, change_id) if temporary else None,
            session=author.session,
            request=author.request,
        )
        append(connection, [entry, *_agreed(ask, entry)] if blind else [entry])
        settle_road_works(connection, entry.at)
        return _answered(ask, change_id, _newest(ask, author.session))


def undo_answer(store: Store, author: Author) -> str | None:
    """Take back the last answer that this person gave in this session and has not taken back.

    What others decided about the finding since holds. A decision by two people who agreed falls with the
    opinion of either.

    Returns
    -------
    str or None
        The finding; None where nothing is left to take back.
    """
    check(Decision.OPEN, author.by)
    with store.transaction() as connection:
        ask = asking(connection)
        if (done := _done_before(ask, author)) is not None:
            return done.change_id
        left = answers_of(ask, author)
        if not left:
            return None
        last = left[0]
        log = all_entries(ask, (last.change_id,))
        undone = {entry.undo_of for entry in log if entry.undo_of is not None}
        taken = [e for e in log if is_left(e, undone) and (e.batch == last.batch or _rests_on(e, last, log))]
        present = last.change_id in present_evidence(ask, (last.change_id,))
        take_back(
            connection,
            log,
            taken,
            by=author.by,
            at=utc_now(),
            session=author.session,
            request=author.request,
            only=(last.change_id,) if present else None,
        )
    return last.change_id


def answers_of(ask: Ask, author: Author) -> list[Entry]:
    """Return what this person answered in this session and has not taken back, the newest first."""
    log = schema.decision_log
    undo = log.alias()
    taken_back = sa.exists().where(undo.c.undo_of == log.c.id, undo.c.change_id == log.c.change_id)
    rows = ask(
        sa.select(log)
        .where(log.c.session == author.session, log.c.by == author.by)
        .where(log.c.kind.in_((DECIDED, OPINION)), ~taken_back)
        .order_by(log.c.id.desc())
    )
    return [Entry.from_row(row) for row in rows]


def _revision(evidence: Evidence, last: Entry | None) -> str:
    text = json.dumps(evidence.as_json(), sort_keys=True)
    return f"{hashlib.sha256(text.encode()).hexdigest()[:12]}-{0 if last is None else last.id}"


def _refuse_seen_otherwise(
    seen: str, evidence: Evidence, last: Entry | None, decision: str, *, blind: bool
) -> None:
    now = _revision(evidence, last)
    if seen == now and not (blind and last is not None and last.decision != Decision.OPEN):
        return
    if seen.partition("-")[0] != now.partition("-")[0]:
        raise SeenOtherwiseError(None)
    # Two people who say the same at once are both kept.
    if last is not None and (blind or last.decision != decision):
        raise SeenOtherwiseError(last)


def _done_before(ask: Ask, author: Author) -> Entry | None:
    """Return the entry that this very request made when it came before."""
    if author.request is None:
        return None
    log = schema.decision_log
    rows = ask(sa.select(log).where(log.c.request == author.request))
    if rows and rows[0]["by"] != author.by:
        raise RefusedError("This request's key was used by somebody else: load the page anew.")
    return Entry.from_row(rows[0]) if rows else None


def _answered(ask: Ask, change_id: str, entry: Entry) -> Answered:
    holds = last_entries(ask, (change_id,)).get(change_id)
    return Answered(change_id, Decision.OPEN if holds is None else holds.decision, entry.id)


def _newest(ask: Ask, session: str) -> Entry:
    log = schema.decision_log
    return Entry.from_row(
        ask(sa.select(log).where(log.c.session == session).order_by(log.c.id.desc()).limit(1))[0]
    )


def _agreed(ask: Ask, mine: Entry) -> list[Entry]:
    """The decision that follows where others, who did not see this opinion, said the same."""
    others = agreeing(opinions_of(ask, (mine.change_id,)).get(mine.change_id, ()), mine)
    if not others:
        return []
    people = [*(other.by for other in others), mine.by]
    reasons = [entry.reason for entry in (*others, mine) if entry.reason]
    return [
        Entry(
            mine.change_id,
            mine.decision,
            "; ".join(dict.fromkeys(reasons)),
            _AND.join(people),
            mine.at,
            mine.evidence,
            DECIDED,
            cause=mine.cause,
            session=mine.session,
        )
    ]


def _rests_on(entry: Entry, opinion: Entry, log: list[Entry]) -> bool:
    """Whether a decision is that of people who agreed, and this opinion one of theirs."""
    if opinion.kind != OPINION or entry.kind != DECIDED or entry.id < opinion.id:
        return False
    by_opinion = any(e.kind == OPINION and e.batch == entry.batch for e in log)
    return by_opinion and entry.decision == opinion.decision and opinion.by in entry.by.split(_AND)
