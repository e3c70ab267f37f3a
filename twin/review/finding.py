"""One finding as its screen shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.earth.heights import nn2000_from_ellipsoidal
from nvdb.datakatalog import SKILTPLATE, SKILTPUNKT
from twin.decisions.answers import revision_seen
from twin.decisions.findings import findings_statement, told_reason
from twin.decisions.log import history
from twin.review import sentences
from twin.review.drives import Drives, degrees_from_utm33
from twin.review.index import Eyes, Index, states
from twin.review.records import Claim, FindingRecord, HistoryItem, Seen, Sign, State, Term
from twin.review.shapes import Seeing, ellipse_major95_m, map_of
from twin.store import schema
from twin.store.kinds import QUIET, Decision
from twin.store.records import Estimate, Finding
from twin.store.store import Row, Snapshot

_VEGKART = "https://vegkart.atlas.vegvesen.no/#valgt:{id}:{type}"


@dataclass(frozen=True, slots=True)
class _Told:
    """A finding with what is decided."""

    finding: Finding
    decision: Decision


def finding_record(
    view: Snapshot, change_id: str, index: Index, drives: Drives, eyes: Eyes, notice: str | None
) -> FindingRecord | None:
    """Gather what the store knows of one finding.

    Parameters
    ----------
    view : Snapshot
    change_id : str
    index : Index
        Of the same state of the store.
    drives : Drives
    eyes : Eyes
        Whose screen it is.
    notice : str or None
        Why nothing can be answered now.

    Returns
    -------
    FindingRecord or None
        None where the last match has no such finding.
    """
    told = _told(view, change_id)
    if told is None:
        return None
    finding = told.finding
    state = _state(view, told, eyes)
    estimates = _estimates(view, finding)
    by_drive = {estimate.drive_id: estimate for estimate in estimates}
    shown = drives.get(view, finding.drive_ids)
    objects = _objects(view, finding)
    place = _nvdb_place(objects)
    row = index.row.get(change_id)
    first, last = _seen_times(estimates)
    return FindingRecord(
        change_id=change_id,
        revision=revision_seen(view.rows, change_id),
        verdict=finding.verdict,
        verdict_title=sentences.VERDICTS[finding.verdict],
        state=state,
        confidence=finding.confidence,
        can_answer=notice is None and finding.verdict not in QUIET,
        notice=notice,
        seen_sentence=sentences.seen_sentence(len(finding.drive_ids), finding.cameras, first, last),
        reason=finding.reason,
        road="" if row is None else index.place[row].reference,
        claim=_claim(finding, objects, index),
        seen=_seen(finding, estimates, index),
        distance_m=finding.distance_m,
        crops=[],
        gaps=[],
        terms=_terms(finding.terms),
        history=_history(view, told, state, eyes),
        map=map_of(view, finding, place, [Seeing(one, by_drive.get(one.drive_id)) for one in shown], index),
    )


def _told(view: Snapshot, change_id: str) -> _Told | None:
    statement = findings_statement(*schema.change.columns).where(schema.change.c.change_id == change_id)
    rows = view.rows(statement)
    if not rows:
        return None
    reason = told_reason(rows[0]["reason"], rows[0]["kind"], rows[0]["note"])
    return _Told(Finding.from_row({**rows[0], "reason": reason}), Decision(rows[0]["decision"]))


def _state(view: Snapshot, told: _Told, eyes: Eyes) -> State:
    change_id = told.finding.change_id
    return states(view.rows, {change_id: told.decision}, eyes, (change_id,)).get(change_id, State.OPEN)


def _estimates(view: Snapshot, finding: Finding) -> list[Estimate]:
    """What the drives measured of the pole that a finding is about, by the method that was matched."""
    key, estimate = schema.pole_key.c, schema.estimate
    pole = finding.terms.get("pole")
    if pole is None:
        return []
    members = [row["member"] for row in view.rows(sa.select(key.member).where(key.pole == pole))]
    method = (view.fact("last_match") or {}).get("method", "")
    ids = [f"{member}:{method}" for member in members]
    rows = view.rows(sa.select(estimate).where(estimate.c.estimate_id.in_(ids)).order_by(estimate.c.first_ns))
    return [Estimate.from_row(row) for row in rows]


def _objects(view: Snapshot, finding: Finding) -> list[Row]:
    """The mirror's row of the object that a finding is about, then those of its plates."""
    if finding.nvdb_id is None:
        return []

    def rows(table: sa.Table, wanted: sa.ColumnElement[bool]) -> list[Row]:
        columns = [column for column in table.columns if column.name not in ("raw", "stedfesting")]
        return view.rows(sa.select(*columns).where(wanted))

    own = schema.MIRROR[finding.nvdb_type].visible
    found = rows(own, own.c.nvdb_id == finding.nvdb_id)
    if finding.nvdb_type == SKILTPUNKT and found:
        plate = schema.skiltplate
        found += rows(plate, plate.c.nvdb_id.in_(found[0]["plate_ids"]))
    elif finding.nvdb_type == SKILTPLATE and found and found[0]["east_m"] is None:
        point = schema.skiltpunkt
        found += rows(point, point.c.nvdb_id == found[0]["point_id"])
    return found


def _nvdb_place(objects: Sequence[Row]) -> FloatArray | None:
    """Where NVDB has it: the object's own place, or that of what it hangs on."""
    placed = (row for row in objects if row["east_m"] is not None and row["own_geometry"])
    first = next(placed, None)
    return None if first is None else np.array([first["east_m"], first["north_m"]], dtype=np.float64)


def _claim(finding: Finding, objects: Sequence[Row], index: Index) -> Claim | None:
    if finding.nvdb_id is None:
        return None
    own = objects[0] if objects else None
    place = _nvdb_place(objects)
    lon, lat = (None, None) if place is None else degrees_from_utm33(place[None])[0]
    texts = [row["text"] for row in objects if row.get("text")]
    return Claim(
        nvdb_id=finding.nvdb_id,
        nvdb_type=finding.nvdb_type,
        version=finding.nvdb_version,
        codes=_signs(finding.skiltnummer_nvdb, index),
        text="; ".join(texts),
        lon=lon,
        lat=lat,
        accuracy_cm=None if own is None else own["accuracy_cm"],
        last_modified=None if own is None else own["last_modified"],
        url_vegkart=_VEGKART.format(id=finding.nvdb_id, type=finding.nvdb_type),
    )


def _seen(finding: Finding, estimates: Sequence[Estimate], index: Index) -> Seen | None:
    if not finding.n_sightings:
        return None
    lat, lon = geographic_from_utm33(finding.east_m, finding.north_m)
    heights = [one.height_m for one in estimates if np.isfinite(one.height_m)]
    height = float(nn2000_from_ellipsoidal(lat, lon, np.mean(heights)).height_m) if heights else np.nan
    covariance = finding.covariance_m2
    texts = [one.text for one in estimates if one.text]
    return Seen(
        codes=_signs(finding.skiltnummer_seen, index),
        text=texts[-1] if texts else "",
        lon=round(float(lon), 7),
        lat=round(float(lat), 7),
        height_m=round(height, 2) if np.isfinite(height) else None,
        sigma_sentence="" if covariance is None else sentences.sigma_sentence(ellipse_major95_m(covariance)),
    )


def _signs(codes: Sequence[str], index: Index) -> list[Sign]:
    return [index.names.sign(code.strip()) for code in codes if code.strip()]


def _seen_times(estimates: Sequence[Estimate]) -> tuple[int | None, int | None]:
    if not estimates:
        return None, None
    return min(one.first_ns for one in estimates), max(one.last_ns for one in estimates)


def _terms(terms: Mapping[str, object]) -> list[Term]:
    odds = terms.get("log_odds")
    found = []
    if isinstance(odds, Mapping):
        for name, value in odds.items():
            label, explanation = sentences.TERMS.get(name, (name, ""))
            found.append(Term(label, f"{value:+.1f}", explanation))
    absence = terms.get("absence")
    if isinstance(absence, Mapping):
        frames, drives = (
            sentences.counted(absence["frames"], "picture"),
            sentences.counted(absence["drives"], "drive"),
        )
        told = f"Its place was in view in {frames} of {drives}."
        found.append(Term("Gone", f"{absence['gone']:.0%}", told))
    if "code" in terms:
        told = "How sure the sign code is that was read."
        found.append(Term("Code read", f"{terms['code']:.0%}", told))
    match = terms.get("match")
    if isinstance(match, float):
        found.append(Term("Pair", f"{match:.1%}", "How sure it is which sign of NVDB this is, if any."))
    return found


def _history(view: Snapshot, told: _Told, state: State, eyes: Eyes) -> list[HistoryItem]:
    """The log, newest first; others' opinions when they have met; to the blind once it is decided."""
    is_told = told.decision is not Decision.OPEN or (state is State.DISAGREEMENT and not eyes.blind)
    return [
        HistoryItem(e.at, e.by, e.decision, e.reason, sentences.entry_sentence(e))
        for e in reversed(history(view.rows, told.finding.change_id))
        if e.holds or is_told or e.by == eyes.reviewer
    ]
