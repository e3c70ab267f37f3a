"""Findings of a store that people have accepted → groups of operations for API Skriv."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from nvdb.datakatalog import Datakatalog, katalog_from_document, snapshot
from nvdb.endringssett import ADVARSEL, Endringssett, endringssett, errors, validate
from twin.changesets.drive_side import Seen, seen_of
from twin.changesets.kontekst import with_findings
from twin.changesets.nvdb_side import earlier_states, mirrored_near
from twin.changesets.operations import Basis, Group, LeftOut, known_pole, new_pole
from twin.changesets.places import RoadPlaces
from twin.changesets.sent import SentFinding, SentLog
from twin.decisions.findings import latest_findings
from twin.decisions.log import Entry, last_entries
from twin.matching.sites import SKILTPUNKT, Site
from twin.store.kinds import Decision, Verdict
from twin.store.records import Finding
from twin.store.store import Snapshot, Store


@dataclass(frozen=True, slots=True)
class Sett:
    """One change set and what it came from.

    Attributes
    ----------
    sett : Endringssett
    groups : tuple of Group
    errors, warnings : tuple of str
        What our own checks found, a sentence each. A set with errors must not be sent.
    before : tuple of JSON objects
        The objects that it changes, as received from NVDB: what undoing it needs.
    not_undone : tuple of str
        What stands against undoing it, a clause each.
    """

    sett: Endringssett
    groups: tuple[Group, ...]
    errors: tuple[str, ...]
    warnings: tuple[str, ...]
    before: tuple[Mapping[str, Any], ...]
    not_undone: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ChangeSets:
    """What findings with one decision became.

    Attributes
    ----------
    decision : str
    setts : tuple of Sett
    left_out : tuple of LeftOut
        Findings that cannot become an operation.
    sent : mapping of change_id → SentFinding
        Findings that are under way to NVDB or carried out: left out too.
    findings : mapping of change_id → Finding, of all that were looked at
    seen : mapping of change_id → Seen
    read : mapping of change_id → when the mirror fetched its object; absent where NVDB has none
    decided : mapping of change_id → the standing entry of the log; absent where nobody ever decided
    match : mapping
        Of the match that found them: ``method``, ``config_sha256`` and the ``settings`` that it is of.
    """

    decision: str
    setts: tuple[Sett, ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    sent: Mapping[str, SentFinding] = field(default_factory=dict)
    findings: Mapping[str, Finding] = field(default_factory=dict)
    seen: Mapping[str, Seen] = field(default_factory=dict)
    read: Mapping[str, str] = field(default_factory=dict)
    decided: Mapping[str, Entry] = field(default_factory=dict)
    match: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_preview(self) -> bool:
        """Whether these are findings that nobody has accepted: nothing to send."""
        return self.decision != Decision.ACCEPT


def groups_from_store(
    store: Store, decision: str = Decision.ACCEPT, *, log: SentLog | None = None, again: Collection[str] = ()
) -> ChangeSets:
    """Turn the findings with one decision into change sets.

    ========== ================================================================================
    verdict    operation
    ========== ================================================================================
    wrong_type ``delvisOppdater`` of the plate from the day of the drive
    new        ``registrer`` of pole and plates; of a plate on a known pole, which is updated
    missing    ``lukk`` on the day of the drive
    moved      ``delvisKorriger`` where NVDB's accuracy explains it, else ``delvisOppdater``
    ========== ================================================================================

    Parameters
    ----------
    store : Store
        Matched, and neither synced nor ingested into since.
    decision : str
        ``accept``; any other gives a preview.
    log : SentLog, optional
        What this one holds is left out.
    again : collection of str
        Findings that are not left out for that.

    Raises
    ------
    StoreError, RefusedError
        As :meth:`twin.store.store.Store.matched`.
    """
    with store.snapshot() as view:
        last = view.matched()
        fact = view.fact("datakatalog")
        katalog = katalog_from_document(fact) if fact else snapshot()
        chosen = [
            one.finding for one in latest_findings(view.rows) if one.decision == decision and not one.is_quiet
        ]
        held = {} if log is None else log.holding(chosen)
        held = {key: one for key, one in held.items() if key not in again}
        chosen = [finding for finding in chosen if finding.change_id not in held]
        if not chosen:
            return ChangeSets(decision, sent=held)
        said = last_entries(view.rows)
        seen = seen_of(view, chosen, last["method"])
        mirrored = mirrored_near(view, chosen)
        basis = Basis(mirrored, seen, RoadPlaces(store), katalog)
        parts = list(_parts(chosen, basis))
        groups = tuple(part for part in parts if isinstance(part, Group))
        setts = tuple(_setts(view, groups, katalog))
    return ChangeSets(
        decision=decision,
        setts=setts,
        left_out=tuple(part for part in parts if isinstance(part, LeftOut)),
        sent=held,
        findings={finding.change_id: finding for finding in chosen},
        seen=seen,
        read={
            finding.change_id: mirrored.rows[key]["synced_at"]
            for finding in chosen
            if (key := (finding.nvdb_type, finding.nvdb_id or 0)) in mirrored.rows
        },
        decided={one.change_id: said[one.change_id] for one in chosen if one.change_id in said},
        # Not when: the same findings give the same files.
        match={name: last.get(name) for name in ("method", "config_sha256", "settings")},
    )


def _parts(chosen: Sequence[Finding], basis: Basis) -> Iterator[Group | LeftOut]:
    """Groups in the order of their first finding's id; the same findings give the same groups."""
    poles: dict[tuple[int, int], tuple[Site, list[Finding]]] = {}
    for finding in chosen:
        key, verdict = finding.change_id, finding.verdict
        if verdict == Verdict.REVIEW:
            yield LeftOut(key, f"{key} is left out: a finding for review is not sure enough to be sent.")
            continue
        if verdict == Verdict.NEW and finding.nvdb_type == SKILTPUNKT:
            yield new_pole(finding, basis)
            continue
        site = basis.mirrored.site_of(finding)
        if site is None:
            yield LeftOut(
                key, f"{key} ({verdict}) is left out: the mirror has no such sign, run `twin match` again."
            )
            continue
        poles.setdefault((site.nvdb_type, site.nvdb_id), (site, []))[1].append(finding)
    for site, about in poles.values():
        yield from known_pole(site, about, basis)


def _setts(view: Snapshot, groups: Sequence[Group], katalog: Datakatalog) -> Iterator[Sett]:
    left = list(groups)
    for sett in endringssett([g.endringer for g in groups], datakatalogversjon=katalog.version):
        own, n = [], 0
        while n < len(sett.endringer):
            own.append(left.pop(0))
            n += len(own[-1].endringer)
        sett = with_findings(sett, own)  # noqa: PLW2901  (the same set, with its findings)
        found = validate(sett, katalog)
        before, problems = earlier_states(view, sett.endringer, katalog)
        yield Sett(
            sett=sett,
            groups=tuple(own),
            errors=tuple(str(finding) for finding in errors(found)),
            warnings=tuple(str(finding) for finding in found if finding.severity == ADVARSEL),
            before=tuple(before),
            not_undone=tuple(problems),
        )
