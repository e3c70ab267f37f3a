"""The store → the layers of an export."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from nvdb.datakatalog import SKILTPUNKT
from twin.belief import believe, roads_to_drive
from twin.decisions.findings import findings_statement, latest_findings
from twin.decisions.log import BY_TWIN
from twin.export.layers import COLUMNS, EPSG_UTM33, ExportLayers
from twin.export.pictures import NO_PICTURES, Pictures
from twin.mirror.names import sign_names
from twin.mirror.roads import roads_of
from twin.store import frames, schema
from twin.store.kinds import Verdict
from twin.store.records import Finding
from twin.store.store import Snapshot, Store
from twin.words import Lang, SignNames, reason_of, sign_titles

if TYPE_CHECKING:
    import geopandas as gpd
    import pandas as pd

Columns = Mapping[str, Any]

_PLACE = ("east_m", "north_m")


def layers_from_store(
    store: Store,
    method: str,
    lang: Lang = Lang.EN,
    pictures: Mapping[str, Pictures] = MappingProxyType({}),
) -> ExportLayers:
    """Read changes with their decisions, the estimates of one method, the mirror and the drives.

    All of it is of one moment, whatever other processes write to the store meanwhile.

    Parameters
    ----------
    store : Store
    method : str
        The method whose estimates were matched.
    lang : Lang, optional
        Of the findings' reasons.
    pictures : mapping of change_id → Pictures, optional
        That the export's folder has.

    Returns
    -------
    ExportLayers
        In EPSG:25833.
    """
    names = sign_names(store)
    # A match of an older twin does not say which drives count as evidence.
    has_evidence = "drives" in (store.fact("last_match") or {}).get("settings", {})
    believed = _believed(store) if has_evidence else {}
    with store.snapshot() as view:
        signs = _signs(view)
        findings = [one.finding for one in latest_findings(view.rows)]
        words = _words(findings, lang, names)
        words["road"] = [str(road) for road in roads_of(store, findings).values()]
        shown = [pictures.get(one.change_id, NO_PICTURES) for one in findings]
        words |= {"crop_face": [p.face for p in shown], "crop_wide": [p.wide for p in shown]}
        return ExportLayers(
            changes=_changes(view, signs, words),
            estimates=_estimates(view, method),
            nvdb_signs=signs,
            drives=_drives(view, method),
            **believed,
        )


def _believed(store: Store) -> dict[str, gpd.GeoDataFrame]:
    """What is believed of each sign, and the roads to drive, of a matched store."""
    import shapely

    belief = believe(store)
    roads = roads_to_drive(belief.places, p_seen=belief.p_seen)
    rows = {name: [getattr(one, name) for one in belief.places] for name in _names("belief", *_PLACE)}
    rows["verdict"] = [verdict or "" for verdict in rows["verdict"]]
    times = {name: _times(rows[name]) for name in ("last_seen", "last_passed")}
    told = {name: [getattr(one, name) for one in roads] for name in _names("roads_to_drive") - {"road_id"}}
    told["road_id"] = [f"{one.road} {one.kommune}" for one in roads]
    lines = [shapely.LineString(one.line_m) for one in roads]
    return {
        "belief": _frame("belief", {**rows, **times}),
        "roads_to_drive": _frame("roads_to_drive", told, lines),
    }


def _frame(name: str, columns: Columns, geometry: Any = None) -> gpd.GeoDataFrame:
    """Make a layer from columns that hold its own and, unless the geometry is given, east_m and north_m."""
    import geopandas as gpd
    import pandas as pd

    if geometry is None:
        # None becomes NaN.
        east, north = (np.array(columns[axis], dtype=np.float64) for axis in ("east_m", "north_m"))
        geometry = gpd.points_from_xy(east, north)
    data = {c.name: pd.Series(columns[c.name], dtype=c.dtype) for c in COLUMNS[name]}
    return gpd.GeoDataFrame(data, geometry=geometry, crs=EPSG_UTM33)


def _words(findings: Sequence[Finding], lang: Lang, names: SignNames) -> dict[str, list[str]]:
    """What is told of the findings, for people."""
    return {
        "reason": [reason_of(one, lang, names) for one in findings],
        "sign": [_title(one, names) for one in findings],
    }


def _title(finding: Finding, names: SignNames) -> str:
    """The signs seen, or where none was, those of NVDB; of a wrong type both."""
    seen, known = (sign_titles(c, names) for c in (finding.skiltnummer_seen, finding.skiltnummer_nvdb))
    return f"{known} → {seen}" if finding.verdict == Verdict.WRONG_TYPE else seen or known


def _comments(view: Snapshot, change_ids: Sequence[str]) -> dict[str, list[str]]:
    """Comment and author of the decisions that people made; what twin says stands in the reason."""
    said = schema.decision.c
    rows = view.rows(sa.select(said.change_id, said.reason, said.by).where(said.kind.not_in(BY_TWIN)))
    told = {row["change_id"]: (row["reason"], row["by"]) for row in rows}
    pairs = [told.get(change, ("", "")) for change in change_ids]
    return {"comment": [comment for comment, _ in pairs], "author": [author for _, author in pairs]}


def _changes(view: Snapshot, signs: gpd.GeoDataFrame, words: Columns) -> gpd.GeoDataFrame:
    wanted = [column for column in schema.change.columns if column.name in _names("changes", *_PLACE)]
    found = view.columns(findings_statement(*wanted))
    fetched = dict(zip(signs["nvdb_id"].tolist(), signs["synced_at"].tolist(), strict=True))
    newest = max(fetched.values(), default="")
    last = _last_match(view)
    n = len(found["change_id"])
    provenance = {
        "cameras": [cameras or "" for cameras in found["cameras"]],
        "synced_at": [fetched.get(nvdb_id, newest) for nvdb_id in found["nvdb_id"]],
        "software": [last.get("settings", {}).get("software", "")] * n,
        "config_sha256": [last.get("config_sha256", "")] * n,
    }
    return _frame("changes", {**found, **words, **_comments(view, found["change_id"]), **provenance})


def _last_match(view: Snapshot) -> Mapping[str, Any]:
    """Facts of the match that found the changes; read here, so that they are of the same moment."""
    rows = view.rows(sa.select(schema.meta.c.value).where(schema.meta.c.key == "last_match"))
    return json.loads(rows[0]["value"]) if rows else {}


def _estimates(view: Snapshot, method: str) -> gpd.GeoDataFrame:
    found = frames.estimates(view, method)
    # A GeoPackage keeps milliseconds.
    times = {name: found[name].dt.round("ms") for name in ("first_seen", "last_seen")}
    # The foot of a sign is that of a Skiltpunkt.
    types = {"nvdb_type": found["nvdb_type"].fillna(SKILTPUNKT)}
    return _frame("estimates", {**found, **times, **types}, found.geometry.to_numpy())


def _signs(view: Snapshot) -> gpd.GeoDataFrame:
    """Skiltpunkter, then plates; a column that a type does not have is empty."""
    together: dict[str, list[Any]] = {name: [] for name in _names("nvdb_signs", *_PLACE)}
    for kind, tables in schema.MIRROR.items():
        own = [column for column in tables.visible.columns if column.name in together]
        found = view.columns(sa.select(*own))
        n = len(found["nvdb_id"])
        found["nvdb_type"] = [kind] * n
        for name, values in together.items():
            values.extend(found.get(name, [None] * n))
    for column in COLUMNS["nvdb_signs"]:
        if column.dtype == "str":
            together[column.name] = [text or "" for text in together[column.name]]
    return _frame("nvdb_signs", together)


def _drives(view: Snapshot, method: str) -> gpd.GeoDataFrame:
    import shapely

    located = sa.func.count().filter(schema.sighting.c.rejected == "").label("n_sightings")
    counts = view.rows(
        sa.select(schema.sighting.c.drive_id, located)
        .where(schema.sighting.c.method == method)
        .group_by(schema.sighting.c.drive_id)
    )
    n_sightings = {row["drive_id"]: row["n_sightings"] for row in counts}
    wanted = _names("drives", "started_ns", "ended_ns", "line")
    found = view.columns(sa.select(*(column for column in schema.drive.columns if column.name in wanted)))
    found["n_sightings"] = [n_sightings.get(drive_id, 0) for drive_id in found["drive_id"]]
    times = {"started": _utc(found["started_ns"]), "ended": _utc(found["ended_ns"])}
    return _frame("drives", {**found, **times}, shapely.from_wkb(found["line"]))


def _names(layer: str, *more: str) -> set[str]:
    return {column.name for column in COLUMNS[layer]} | set(more)


def _times(texts: Sequence[str | None]) -> pd.DatetimeIndex:
    """Times in ISO 8601 as pandas timestamps; NaT for none."""
    import pandas as pd

    return pd.to_datetime([text or "NaT" for text in texts], utc=True, format="ISO8601").as_unit("ms")


def _utc(epochs_ns: Sequence[int]) -> pd.DatetimeIndex:
    """Epochs as pandas timestamps in UTC, to the millisecond that a GeoPackage keeps."""
    import pandas as pd

    epochs = np.array(epochs_ns, dtype=np.int64)
    return pd.to_datetime(epochs, unit="ns", utc=True).round("ms").as_unit("ms")
