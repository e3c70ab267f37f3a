"""What a store holds as GeoDataFrames, for research: a row an estimate, a finding, a sighting or a drive.

Tables are in EPSG:25833 (UTM 33, metres), times in UTC. What is not known is NaN, NaT or "". The columns and
their units are :data:`COLUMNS`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg
from geoloc.earth.heights import nn2000_from_ellipsoidal
from geoloc.locate.combine import cep95_m, ellipse
from twin.errors import ConfigError
from twin.store import schema
from twin.store.kinds import Decision, Method

if TYPE_CHECKING:
    import geopandas as gpd
    import pandas as pd

    from twin.store.store import Snapshot

EPSG = 25833

_PRECISION = {
    "sigma_east_m": "one sigma of grid east, m",
    "sigma_north_m": "one sigma of grid north, m",
    "correlation": "of east and north, -1 to 1",
    "sigma_major_m": "one sigma along the long axis of the error ellipse, m; times 2.448 it holds 95 %",
    "sigma_minor_m": "one sigma along its short axis, m",
    "sigma_azimuth_deg": "of its long axis, degrees clockwise from true north, 0 to 180",
    "cep95_m": "radius of the circle that holds it with 95 %, m",
}
COLUMNS: Mapping[str, Mapping[str, str]] = {
    "estimates": {
        "estimate_id": "the same in every run",
        "drive_id": "of the drive that saw the object",
        "object": "the annotated object",
        "label": "as annotated",
        "skiltnummer": "sign codes, top down, joined by `;`",
        "text": "on its plates, joined likewise",
        "nvdb_type": "vegobjekttype of what is no sign; NA for signs",
        "method": "`adjusted`, `single-frame` or `paper`",
        "height_m": "of its foot, above the ellipsoid, m; NaN for `paper`, which gives none",
        "sigma_height_m": "one sigma of it, m; `adjusted` only, else NaN",
        "height_nn2000_m": "in NN2000, m; NaN without HREF2018B",
        **_PRECISION,
        "n_sightings": "annotated pixels that took part",
        "n_rejected": "that did not",
        "n_frames": "pictures that took part",
        "n_cameras": "cameras that took part",
        "cameras": "their names, joined by `,`",
        "range_min_m": "distance of the nearest picture, m",
        "first_seen": "UTC",
        "last_seen": "UTC",
        "flags": "remarks, joined by `;`",
    },
    "findings": {
        "change_id": "the same in every run",
        "verdict": "`unchanged`, `moved`, `wrong_type`, `new`, `missing`, `not_observable` or `review`",
        "reason": "why, in English",
        "confidence": "probability that the verdict is right, 0 to 1",
        "nvdb_type": "95 Skiltpunkt, 96 Skiltplate",
        "nvdb_id": "of NVDB's object; NA for `new`",
        "nvdb_version": "likewise",
        "skiltnummer_nvdb": "sign codes in NVDB, top down, joined by `;`",
        "skiltnummer_seen": "sign codes seen",
        "distance_m": "from NVDB's position to the measured one, m",
        "distance_sigma_m": "one sigma of it, m",
        **_PRECISION,
        "drive_ids": "that saw it or looked for it, joined by `,`",
        "cameras": "likewise",
        "n_sightings": "annotated pixels",
        "decision": "`open`, `accept`, `dismiss` or `defer`",
        "decided_by": "name",
        "decided_at": "UTC",
    },
    "sightings": {
        "drive_id": "",
        "method": "that located it",
        "object": "the annotated object",
        "camera": "its name in the rig file",
        "frame": "number of the picture",
        "time": "of the picture, UTC",
        "kind": "`foot` or `box`",
        "u_px": "to the right of the first pixel's centre, px",
        "v_px": "down from it, px",
        "width_px": "of a box, px",
        "height_px": "of a box, px",
        "range_m": "from the camera to the object in plan, m",
        "speed_mps": "of the car, m/s",
        "residual_u_px": "seen minus expected, px; `adjusted` only",
        "residual_v_px": "the same downwards, px",
        "eye_east_m": "of the camera, EPSG:25833, m; `adjusted` only",
        "eye_north_m": "likewise",
        **_PRECISION,
        "rejected": "why it did not take part; empty where it did. `single-frame` and `paper`: NA where the"
        " picture gave a position; which of these were outliers is not kept (`n_rejected` of `estimates` has"
        " their number)",
        "is_measured": "False where the annotation tool interpolated it",
    },
    "drives": {
        "drive_id": "",
        "name": "of its folder",
        "started": "UTC",
        "ended": "UTC",
        "length_m": "driven, m",
        "datum": "of the positions as recorded",
        "methods": "by which it was located, joined by `,`",
        "cameras": "annotated ones, joined by `,`",
        "n_frames": "pictures",
        "n_annotations": "annotated pixels and boxes",
        "annotations_complete": "whether every sign in view was annotated",
        "delay_ms": "of the receiver's link, ms",
        "software": "that located it",
    },
}
"""Table → its columns in their order → what they hold, with the unit; `geometry` comes last."""


def estimates(view: Snapshot, method: str | None = None) -> gpd.GeoDataFrame:
    """As :meth:`twin.Store.estimates`, of one state."""
    table = schema.estimate
    found = view.columns(_of_method(sa.select(table).order_by(table.c.estimate_id), table, method))
    at = _places(found)
    lat, lon = _geographic(at)
    heights = np.array(found["height_m"], dtype=np.float64)
    heights[[name == Method.PAPER for name in found["method"]]] = np.nan
    derived = {
        "height_m": heights,
        "first_seen": _utc(found["first_ns"]),
        "last_seen": _utc(found["last_ns"]),
        "height_nn2000_m": nn2000_from_ellipsoidal(lat, lon, heights).height_m,
        **_precision(found, at),
    }
    return _frame("estimates", {**found, **derived}, _points(at))


def findings(view: Snapshot) -> gpd.GeoDataFrame:
    """As :meth:`twin.Store.findings`, of one state."""
    import pandas as pd

    view.matched()
    table, said = schema.change, schema.decision.c
    told = (said.decision, said.by.label("decided_by"), said.at.label("decided_at"))
    with_decisions = table.outerjoin(schema.decision, said.change_id == table.c.change_id)
    found = view.columns(
        sa.select(*table.columns, *told).select_from(with_decisions).order_by(table.c.change_id)
    )
    at = _places(found)
    derived = {
        "decision": [decision or Decision.OPEN.value for decision in found["decision"]],
        "decided_at": pd.to_datetime(pd.Series(found["decided_at"], dtype="str"), utc=True),
        **_precision(found, at),
    }
    return _frame("findings", {**found, **derived}, _points(at))


def sightings(view: Snapshot, method: str | None = None) -> gpd.GeoDataFrame:
    """As :meth:`twin.Store.sightings`, of one state."""
    table = schema.sighting
    order = (table.c.drive_id, table.c.method, table.c.number)
    found = view.columns(_of_method(sa.select(table).order_by(*order), table, method))
    at = _places(found)
    derived = {
        "time": _utc(found["epoch_ns"]),
        "rejected": _rejected(found["method"], found["rejected"]),
        **_precision(found, at),
    }
    return _frame("sightings", {**found, **derived}, _points(at))


def _rejected(methods: Sequence[str], reasons: Sequence[str]) -> pd.Series[str]:
    """Why sightings took no part; NA where a method may have left them out without keeping which."""
    import pandas as pd

    known = (
        why if why or name == Method.ADJUSTED else None for name, why in zip(methods, reasons, strict=True)
    )
    return pd.Series(list(known), dtype="str")


def drives(view: Snapshot) -> gpd.GeoDataFrame:
    """As :meth:`twin.Store.drives`, of one state."""
    import shapely

    table, by = schema.drive, schema.drive_method.c
    found = view.columns(sa.select(table).order_by(table.c.started_ns, table.c.drive_id))
    methods: dict[str, list[str]] = {}
    for row in view.rows(sa.select(by.drive_id, by.method).order_by(by.method)):
        methods.setdefault(row["drive_id"], []).append(row["method"])
    derived = {
        "started": _utc(found["started_ns"]),
        "ended": _utc(found["ended_ns"]),
        "methods": [methods.get(drive_id, []) for drive_id in found["drive_id"]],
    }
    return _frame("drives", {**found, **derived}, shapely.from_wkb(found["line"]))


def _of_method(statement: sa.Select[Any], table: sa.Table, method: str | None) -> sa.Select[Any]:
    if method is None:
        return statement
    if method not in set(Method):
        raise ConfigError(f"There is no method {method!r}: choose one of {', '.join(Method)}.")
    return statement.where(table.c.method == method)


def _frame(name: str, found: Mapping[str, Any], geometry: Any) -> gpd.GeoDataFrame:
    import geopandas as gpd
    import pandas as pd

    types = {
        c.name: c.type
        for table in (schema.estimate, schema.change, schema.sighting, schema.drive)
        for c in table.columns
    }
    data = {column: _typed(found[column], types.get(column)) for column in COLUMNS[name]}
    return gpd.GeoDataFrame(pd.DataFrame(data), geometry=geometry, crs=EPSG)


def _typed(values: Any, kind: Any) -> Any:
    """Bring a column of the store to its type; one that was derived has it already."""
    import pandas as pd

    if not isinstance(values, list):
        return values
    if isinstance(kind, sa.Float):
        return np.array(values, dtype=np.float64)
    if isinstance(kind, sa.Integer):
        return pd.array(values, dtype="Int64") if None in values else np.array(values, dtype=np.int64)
    if isinstance(kind, sa.Boolean):
        return np.array(values, dtype=bool)
    # Lists of names, and words.
    texts = [",".join(value) if isinstance(value, list) else value or "" for value in values]
    return pd.Series(texts, dtype="str")


def _places(found: Mapping[str, Sequence[Any]]) -> FloatArray:
    """East and north (n, 2); NaN where there is no position."""
    return np.column_stack([np.array(found[name], dtype=np.float64) for name in ("east_m", "north_m")])


def _points(at: FloatArray) -> Any:
    """Points, None where the position is not known."""
    import shapely

    points = np.full(len(at), None, dtype=object)
    known = np.isfinite(at).all(axis=1)
    points[known] = shapely.points(at[known])
    return points


def _geographic(at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Latitude and longitude; NaN where the position is."""
    known = np.isfinite(at).all(axis=1)
    lat, lon = np.full((2, len(at)), np.nan)
    lat[known], lon[known] = geographic_from_utm33(at[known, 0], at[known, 1])
    return lat, lon


def _precision(found: Mapping[str, Sequence[Any]], at: FloatArray) -> dict[str, FloatArray]:
    """The columns of `_PRECISION`; NaN where there is no covariance."""
    names = ("cov_ee_m2", "cov_en_m2", "cov_nn_m2")
    ee, en, nn = (np.array(found[name], dtype=np.float64) for name in names)
    covariance = np.stack([ee, en, en, nn], axis=-1).reshape(-1, 2, 2)
    major, minor, grid_azimuth = ellipse(covariance)
    sigma_east, sigma_north = np.sqrt(ee), np.sqrt(nn)
    values = (
        sigma_east,
        sigma_north,
        en / (sigma_east * sigma_north),
        major,
        minor,
        (grid_azimuth + grid_convergence_deg(*_geographic(at))) % 180.0,
        cep95_m(covariance),
    )
    return dict(zip(_PRECISION, values, strict=True))


def _utc(epochs_ns: Sequence[int]) -> pd.DatetimeIndex:
    import pandas as pd

    return pd.to_datetime(np.array(epochs_ns, dtype=np.int64), unit="ns", utc=True)
