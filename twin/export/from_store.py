"""The store → the four layers of an export."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from geoloc.combine import cep95_m, ellipse
from geoloc.geodesy import geographic_from_utm33, grid_convergence_deg
from geoloc.heights import nn2000_from_ellipsoidal
from twin import schema
from twin.decisions.findings import findings
from twin.export.layers import COLUMNS, EPSG_UTM33, ExportLayers
from twin.matching.sites import SKILTPLATE, SKILTPUNKT
from twin.store import Snapshot, Store

if TYPE_CHECKING:
    import geopandas as gpd

Row = Mapping[str, Any]


def layers_from_store(store: Store, method: str) -> ExportLayers:
    """Read changes with their decisions, the estimates of one method, the mirror and the drives.

    All of it is of one moment, whatever other processes write to the store meanwhile.

    Parameters
    ----------
    store : Store
    method : str
        The method whose estimates were matched.

    Returns
    -------
    ExportLayers
        In EPSG:25833.
    """
    with store.snapshot() as view:
        return ExportLayers(
            changes=_changes(view),
            estimates=_estimates(view, method),
            nvdb_signs=_signs(view),
            drives=_drives(view, method),
        )


def _frame(name: str, rows: Sequence[Row], geometry: Any = None) -> gpd.GeoDataFrame:
    """Make a layer from rows that carry its columns and, unless given, east_m and north_m."""
    import geopandas as gpd
    import pandas as pd

    if geometry is None:
        east = np.array([np.nan if row["east_m"] is None else row["east_m"] for row in rows])
        north = np.array([np.nan if row["north_m"] is None else row["north_m"] for row in rows])
        geometry = gpd.points_from_xy(east, north)
    data = {c.name: pd.Series([row[c.name] for row in rows], dtype=c.dtype) for c in COLUMNS[name]}
    return gpd.GeoDataFrame(data, geometry=geometry, crs=EPSG_UTM33)


def _changes(view: Snapshot) -> gpd.GeoDataFrame:
    return _frame("changes", findings(view.rows))


def _estimates(view: Snapshot, method: str) -> gpd.GeoDataFrame:
    rows = view.rows(sa.select(schema.estimate).where(schema.estimate.c.method == method))
    covariance = np.array(
        [[[r["cov_ee_m2"], r["cov_en_m2"]], [r["cov_en_m2"], r["cov_nn_m2"]]] for r in rows]
    ).reshape(-1, 2, 2)
    major, minor, grid_azimuth = ellipse(covariance)
    lat, lon = geographic_from_utm33(
        np.array([r["east_m"] for r in rows]), np.array([r["north_m"] for r in rows])
    )
    azimuth = (grid_azimuth + grid_convergence_deg(lat, lon)) % 180.0
    cep95 = cep95_m(covariance)
    nn2000 = nn2000_from_ellipsoidal(lat, lon, np.array([r["height_m"] for r in rows])).height_m
    full = [
        {
            **row,
            "first_seen": _utc(row["first_ns"]),
            "last_seen": _utc(row["last_ns"]),
            "sigma_major_m": major[k],
            "sigma_minor_m": minor[k],
            "sigma_azimuth_deg": azimuth[k],
            "cep95_m": cep95[k],
            "height_nn2000_m": nn2000[k],
        }
        for k, row in enumerate(rows)
    ]
    return _frame("estimates", full)


def _signs(view: Snapshot) -> gpd.GeoDataFrame:
    points = view.rows(sa.select(*_without_raw(schema.skiltpunkt)))
    plates = view.rows(sa.select(*_without_raw(schema.skiltplate)))
    empty = {"point_id": None, "skiltnummer": "", "text": "", "ansiktsside": ""}
    rows = [{**empty, **row, "nvdb_type": SKILTPUNKT} for row in points]
    rows += [{**row, "nvdb_type": SKILTPLATE} for row in plates]
    texts = [c.name for c in COLUMNS["nvdb_signs"] if c.dtype == "str"]
    return _frame("nvdb_signs", [{**row, **{t: row[t] or "" for t in texts}} for row in rows])


def _drives(view: Snapshot, method: str) -> gpd.GeoDataFrame:
    import shapely

    located = sa.func.count().filter(schema.sighting.c.rejected == "").label("n_sightings")
    counts = view.rows(
        sa.select(schema.sighting.c.drive_id, located)
        .where(schema.sighting.c.method == method)
        .group_by(schema.sighting.c.drive_id)
    )
    n_sightings = {row["drive_id"]: row["n_sightings"] for row in counts}
    rows = [
        {
            **row,
            "started": _utc(row["started_ns"]),
            "ended": _utc(row["ended_ns"]),
            "n_sightings": n_sightings.get(row["drive_id"], 0),
        }
        for row in view.rows(sa.select(schema.drive))
    ]
    return _frame("drives", rows, shapely.from_wkb([row["line"] for row in rows]))


def _without_raw(table: sa.Table) -> list[sa.Column[Any]]:
    return [column for column in table.columns if column.name != "raw"]


def _utc(epoch_ns: int) -> Any:
    """Epoch as a pandas timestamp in UTC, to the millisecond that a GeoPackage keeps."""
    import pandas as pd

    return pd.Timestamp(epoch_ns, unit="ns", tz="UTC").round("ms")
