"""One finding as its screen shows it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.earth.heights import nn2000_from_ellipsoidal
from nvdb.datakatalog import SKILTPLATE, SKILTPUNKT
from twin.decisions.answers import revision_seen
from twin.decisions.findings import FindingStatus, latest_findings
from twin.decisions.log import history
from twin.evidence import crops_of, gaps_of
from twin.review import sentences
from twin.review.drives import Drives, degrees_from_utm33
from twin.review.index import Eyes, Index, states
from twin.review.records import Claim, CropItem, FindingRecord, HistoryItem, Seen, Sign, State, Term
from twin.review.shapes import Seeing, map_of, radius95_m
from twin.store import schema
from twin.store.kinds import Decision
from twin.store.records import Estimate, Finding
from twin.store.store import Row, Snapshot
from twin.words import (
    Lang,
    gap_sentence,
    position_sentence,
    reason_of,
    seen_sentence,
    terms_in_words,
    verdict_title,
)

_VEGKART = "https://vegkart.atlas.vegvesen.no/#valgt:{id}:{type}"


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
    found = latest_findings(view.rows, (change_id,))
    if not found:
        return None
    told, finding = found[0], found[0].finding
    state = _state(view, told, eyes)
    estimates = _estimates(view, finding)
    by_drive = {estimate.drive_id: estimate for estimate in estimates}
    shown = drives.get(view, finding.drive_ids)
    objects = _objects(view, finding)
    place = _nvdb_place(objects)
    row = index.row.get(change_id)
    return FindingRecord(
        change_id=change_id,
        revision=revision_seen(view.rows, change_id),
        verdict=finding.verdict,
        verdict_title=verdict_title(finding.verdict, eyes.lang),
        state=state,
        confidence=finding.confidence,
        can_answer=notice is None and not told.is_quiet,
        notice=notice,
        seen_sentence=seen_sentence(finding, eyes.lang, [sentences.day_of(one.started_ns) for one in shown]),
        reason=reason_of(finding, eyes.lang, index.names),
        road="" if row is None else index.place[row].reference,
        claim=_claim(finding, objects, index),
        seen=_seen(finding, estimates, index, eyes.lang),
        distance_m=finding.distance_m,
        crops=_crops(view, change_id, {one.drive_id: one.name for one in shown}, eyes.lang),
        gaps=[gap_sentence(gap.why, eyes.lang) for gap in gaps_of(view.rows, change_id)],
        terms=[Term(one.label, one.value, one.explanation) for one in terms_in_words(finding, eyes.lang)],
        history=_history(view, told, state, eyes, index),
        map=map_of(view, finding, place, [Seeing(one, by_drive.get(one.drive_id)) for one in shown], index),
    )


def _state(view: Snapshot, told: FindingStatus, eyes: Eyes) -> State:
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


def _seen(finding: Finding, estimates: Sequence[Estimate], index: Index, lang: Lang) -> Seen | None:
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
        sigma_sentence="" if covariance is None else position_sentence(radius95_m(covariance), lang),
    )


def _signs(codes: Sequence[str], index: Index) -> list[Sign]:
    return [Sign(code, index.names.get(code, code)) for code in map(str.strip, codes) if code]


def _crops(view: Snapshot, change_id: str, names: Mapping[str, str], lang: Lang) -> list[CropItem]:
    return [
        CropItem(
            number=crop.number,
            role=crop.role,
            url=f"crop/{crop.sha256}.webp",
            width=crop.width_px,
            height=crop.height_px,
            range_m=round(crop.range_m, 1),
            camera=crop.camera,
            when=sentences.day_of(crop.epoch_ns).isoformat(),
            drive=names.get(crop.drive_id, crop.drive_id),
            caption=sentences.crop_caption(crop, lang),
            proof=sentences.proof_sentence(crop, lang),
        )
        for crop in crops_of(view.rows, change_id)
    ]


def _history(
    view: Snapshot, told: FindingStatus, state: State, eyes: Eyes, index: Index
) -> list[HistoryItem]:
    """The log, newest first; others' opinions when they have met; to the blind once it is decided."""
    is_told = told.decision is not Decision.OPEN or (state is State.DISAGREEMENT and not eyes.blind)
    return [
        HistoryItem(e.at, e.by, e.decision, e.reason, sentences.entry_sentence(e, eyes.lang, index.names))
        for e in reversed(history(view.rows, told.finding.change_id))
        if e.holds or is_told or e.by == eyes.reviewer
    ]
