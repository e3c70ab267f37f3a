"""Match the store's estimates against its mirror of NVDB and keep the findings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import sqlalchemy as sa

from twin import __version__
from twin.errors import StoreError
from twin.matching.asked import Asked, choose_method
from twin.matching.config import MatchConfig
from twin.matching.found import Found, everything, touched_part
from twin.matching.kept import Kept, NotSure
from twin.matching.left import COUNTED
from twin.matching.news import News
from twin.matching.save import Part, save_changes
from twin.matching.tiles import put_together
from twin.store import schema
from twin.store.kinds import Verdict
from twin.store.records import Finding
from twin.store.store import Row, Store, utc_now
from twin.words import sentence


@dataclass(frozen=True, slots=True)
class MatchReport:
    """What a match found.

    Attributes
    ----------
    method : str
        Whose estimates were matched.
    verdicts : dict
        Verdict → number of findings, every verdict named.
    n_poles, n_sites : int
        Observed poles; NVDB sites near a drive that have any position.
    n_in_view : int
        Sites that a completely annotated drive had in view.
    n_outdated : int
        Poles of earlier drives that a later, completely annotated drive passed without seeing them: left out.
    map_aided : str
        What measured signs did to the poles, if these were asked to; "" if not.
    news : News or None
        What the match before did not find; None of the first one.
    warnings : tuple of str
        Drives that do not fit themselves, and complete ones that cannot show that a sign is missing.
    kept_agree : bool or None
        Whether what was kept of earlier matches gives the same findings; None where that was not asked for,
        or the store changed meanwhile.
    """

    method: str
    verdicts: dict[Verdict, int]
    n_poles: int
    n_sites: int
    n_in_view: int
    n_outdated: int
    map_aided: str
    news: News | None = None
    warnings: tuple[str, ...] = ()
    kept_agree: bool | None = None


def match(
    store: Store,
    *,
    method: str | None = None,
    config: MatchConfig | None = None,
    progress: Callable[[str], None] | None = None,
    anew: bool = False,
) -> MatchReport:
    """Compare every estimate of one method with the mirror, and replace the store's findings.

    What earlier matches worked out of drives and places that nothing has touched is taken from the store
    (:mod:`twin.matching.kept`): the findings are those of a match without it.

    Parameters
    ----------
    store : Store
    method : str, optional
        Default: the best that drives were ingested by, in the order of :class:`twin.store.kinds.Method`.
    config : MatchConfig, optional
    anew : bool
        Work everything out, and say whether what was kept agrees.

    Raises
    ------
    StoreError
        No drive was ingested, nothing was synced, or no drive was ingested by the method.
    """
    if store.read_only is not None:  # at once, not after the work
        raise store.read_only
    config = config or MatchConfig()
    say = progress or (lambda _text: None)
    method = choose_method(store, method)
    if store.fact("mirror") is None:
        raise StoreError(f"The store {store.name} has no NVDB signs yet: run `twin sync-nvdb` first.")
    kept_agree = None
    with store.snapshot() as view:
        asked = Asked(store, view, method, config, say)
        if anew:
            found = everything(asked, Kept())
            say("matching once more from what was kept")
            kept_agree = _agree(replace(asked, say=lambda _text: None), found)
        else:
            found = _touched_or_everything(asked)
        last = view.fact("last_match")
    settings = _settings(method, config, found, last) | {"road_network": found.has_network}
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()
    run: dict[str, Any] = {"method": method, "at": utc_now(), "settings": settings, "config_sha256": digest}
    part = None if found.gone is None else Part(found.gone, found.members_gone, last)
    run["revision"] = found.revision
    try:
        news = save_changes(store, found.findings, found.keys, run, found.marks, found.kept, part)
    except NotSure:  # another match was saved meanwhile
        return match(store, method=method, config=config, progress=progress)
    totals = dict(zip(COUNTED, found.state.totals.tolist(), strict=True))
    return MatchReport(
        method=method,
        verdicts=_counts(store),
        n_poles=totals["poles"],
        n_sites=totals["sites"],
        n_in_view=totals["in view"],
        n_outdated=totals["outdated"],
        map_aided=found.map_aided,
        news=news,
        kept_agree=kept_agree,
        warnings=tuple(told for _, said in sorted(found.state.warnings.values()) for told in said),
    )


def _counts(store: Store) -> dict[Verdict, int]:
    verdict, count = schema.change.c.verdict, sa.func.count().label("n")
    rows = store.rows(sa.select(verdict, count).group_by(verdict))
    counts = dict.fromkeys(Verdict, 0)
    counts.update((Verdict(row["verdict"]), row["n"]) for row in rows)
    return counts


def _touched_or_everything(asked: Asked) -> Found:
    """Look at what was touched since the last match, or where that is not enough at everything."""
    try:
        part = touched_part(asked, Kept(asked.view))
    except NotSure:
        asked.say("what was touched may reach further: matching everything")
        part = None
    part = part or put_together(asked, Kept(asked.view))
    return everything(asked, Kept(asked.view)) if part is None else part


def _agree(asked: Asked, found: Found) -> bool:
    """Whether what earlier matches left gives the same findings and poles."""
    again = everything(asked, Kept(asked.view))
    if _told(again.findings) != _told(found.findings) or again.keys != found.keys:
        return False
    try:
        part = touched_part(asked, Kept(asked.view))
    except NotSure:
        return True
    if part is None or part.gone is None:
        return True
    change, key = schema.change, schema.pole_key
    stays = {row["change_id"]: row for row in asked.view.rows(sa.select(change))}
    for change_id in part.gone:
        stays.pop(change_id, None)
    keys = {row["member"]: row["pole"] for row in asked.view.rows(sa.select(key))}
    keys = {member: pole for member, pole in keys.items() if member not in part.members_gone} | part.keys
    rows = [*stays.values(), *(finding.to_row() for finding in part.findings)]
    return _rows(rows) == _told(found.findings) and keys == found.keys


def _told(findings: Sequence[Finding]) -> list[str]:
    return _rows([finding.to_row() for finding in findings])


def _rows(rows: Sequence[Row]) -> list[str]:
    return sorted(json.dumps(row, sort_keys=True) for row in rows)


def _settings(method: str, config: MatchConfig, found: Found, last: Row | None) -> dict[str, Any]:
    """Everything that findings depend on but NVDB: by its SHA-256 two runs are known to be alike.

    A drive's files (``drive.toml`` among them) are known by their hash. Drives that were not looked at are as
    they were at the last match.
    """
    before = ((last or {}).get("settings") or {}).get("drives", {})
    now = {
        drive.drive_id: {
            "content_sha256": drive.content_sha256,
            "estimates_sha256": found.known[drive.drive_id].estimates_sha256,
            "complete": drive.is_evidence,
            "doubt": "" if drive.doubt is None else sentence(drive.doubt),
        }
        for drive in found.drives
    }
    drives = {drive_id: now.get(drive_id) or before[drive_id] for drive_id in sorted(found.state.squares)}
    return {
        "software": f"nvdb-twin {__version__}",
        "method": method,
        "matching": asdict(config),
        "drives": drives,
    }
