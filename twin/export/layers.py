"""What is exported: layers with exact columns, checked and put in order before any byte is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from twin.errors import ExportRefusedError
from twin.store.kinds import Decision, Verdict
from twin.words import Lang, say

if TYPE_CHECKING:
    import geopandas as gpd
    import pandas as pd

EPSG_UTM33 = 25833
EPSG_WGS84 = 4326
NO_DATA_TIME = "1970-01-01T00:00:00.000Z"


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a layer.

    Attributes
    ----------
    layer, name : str
    dtype : str
        ``str`` (never null: "" where unknown), ``int64``, ``Int64`` (nullable), ``float64`` (NaN is null),
        ``bool`` or ``datetime64[ms, UTC]`` (NaT is null).
    unit : str
        "" where there is none.
    """

    layer: str
    name: str
    dtype: str
    unit: str = ""

    @property
    def label(self) -> str:
        """What a person reads in QGIS, with the unit: ``Distance (m)``."""
        return self.label_in(Lang.EN)

    def label_in(self, lang: Lang) -> str:
        """The same in a language."""
        alias = say(lang, f"alias.{self.layer}.{self.name}")
        return f"{alias} ({self.unit})" if self.unit else alias


TIME = "datetime64[ms, UTC]"
"""Milliseconds, because a GeoPackage DATETIME holds no more."""

_COLUMNS: dict[str, tuple[tuple[str, str] | tuple[str, str, str], ...]] = {
    "changes": (
        ("change_id", "str"),
        ("verdict", "str"),
        ("reason", "str"),
        ("confidence", "float64", "0–1"),
        ("nvdb_type", "int64"),
        ("nvdb_id", "Int64"),
        ("nvdb_version", "Int64"),
        ("skiltnummer_nvdb", "str"),
        ("skiltnummer_seen", "str"),
        ("distance_m", "float64", "m"),
        ("distance_sigma_m", "float64", "m"),
        ("drive_ids", "str"),
        ("n_sightings", "int64"),
        ("decision", "str"),
        ("cameras", "str"),
        ("synced_at", "str"),
        ("software", "str"),
        ("config_sha256", "str"),
        ("sign", "str"),
        ("road", "str"),
        ("comment", "str"),
        ("author", "str"),
        ("crop_face", "str"),
        ("crop_wide", "str"),
    ),
    "moves": (
        ("change_id", "str"),
        ("verdict", "str"),
        ("distance_m", "float64", "m"),
        ("distance_sigma_m", "float64", "m"),
    ),
    "belief": (
        ("place_id", "str"),
        ("nvdb_type", "Int64"),
        ("nvdb_id", "Int64"),
        ("skiltnummer", "str"),
        ("state", "str"),
        ("p_stands", "float64", "0–1"),
        ("unsure_bits", "float64", "bit"),
        ("last_seen", TIME, "UTC"),
        ("last_passed", TIME, "UTC"),
        ("n_seen", "int64"),
        ("n_missed", "int64"),
        ("verdict", "str"),
        ("road", "str"),
        ("kommune", "str"),
    ),
    "roads_to_drive": (
        ("road_id", "str"),
        ("road", "str"),
        ("kommune", "str"),
        ("km", "float64", "km"),
        ("n_places", "int64"),
        ("n_unsure", "int64"),
        ("n_not_passed", "int64"),
        ("unsure_bits", "float64", "bit"),
        ("settled_bits", "float64", "bit"),
        ("settled_bits_per_km", "float64", "bit/km"),
    ),
    "nvdb_signs": (
        ("nvdb_id", "int64"),
        ("nvdb_type", "int64"),
        ("version", "Int64"),
        ("point_id", "Int64"),
        ("skiltnummer", "str"),
        ("text", "str"),
        ("own_geometry", "bool"),
        ("accuracy_cm", "float64", "cm"),
        ("capture_method", "str"),
        ("road_reference", "str"),
        ("ansiktsside", "str"),
        ("last_modified", "str"),
        ("synced_at", "str"),
    ),
    "estimates": (
        ("estimate_id", "str"),
        ("drive_id", "str"),
        ("object", "str"),
        ("label", "str"),
        ("skiltnummer", "str"),
        ("nvdb_type", "int64"),
        ("method", "str"),
        ("n_sightings", "int64"),
        ("n_frames", "int64"),
        ("n_cameras", "int64"),
        ("first_seen", TIME, "UTC"),
        ("last_seen", TIME, "UTC"),
        ("range_min_m", "float64", "m"),
        ("height_m", "float64", "m"),
        ("height_nn2000_m", "float64", "m"),
        ("sigma_major_m", "float64", "m"),
        ("sigma_minor_m", "float64", "m"),
        ("sigma_azimuth_deg", "float64", "° clockwise"),
        ("cep95_m", "float64", "m"),
        ("flags", "str"),
        ("sigma_height_m", "float64", "m"),
        ("sigma_east_m", "float64", "m"),
        ("sigma_north_m", "float64", "m"),
        ("correlation", "float64"),
    ),
    "ellipses": (
        ("estimate_id", "str"),
        ("object", "str"),
        ("sigma_major_m", "float64", "m"),
        ("sigma_minor_m", "float64", "m"),
        ("cep95_m", "float64", "m"),
    ),
    "drives": (
        ("drive_id", "str"),
        ("name", "str"),
        ("started", TIME, "UTC"),
        ("ended", TIME, "UTC"),
        ("n_frames", "int64"),
        ("n_sightings", "int64"),
        ("annotations_complete", "bool"),
        ("datum", "str"),
        ("length_m", "float64", "m"),
    ),
}
COLUMNS: dict[str, tuple[Column, ...]] = {
    layer: tuple(Column(layer, *column) for column in columns) for layer, columns in _COLUMNS.items()
}
"""Layer → its columns, in order; the geometry comes after them. The first layer belongs on top of the map."""

GEOMETRY: dict[str, str] = {
    "changes": "Point",
    "moves": "LineString",
    "belief": "Point",
    "roads_to_drive": "LineString",
    "nvdb_signs": "Point",
    "estimates": "Point",
    "ellipses": "Polygon",
    "drives": "LineString",
}
KEY: dict[str, str] = {
    "changes": "change_id",
    "moves": "change_id",
    "belief": "place_id",
    "roads_to_drive": "road_id",
    "nvdb_signs": "nvdb_id",
    "estimates": "estimate_id",
    "ellipses": "estimate_id",
    "drives": "drive_id",
}
"""Layer → the column that is unique and that its rows are sorted by."""


def description(layer: str, lang: Lang = Lang.EN) -> str:
    """Say what a layer holds."""
    return say(lang, f"opening.layer.{layer}")


_ALLOWED: dict[tuple[str, str], frozenset[object]] = {
    ("changes", "verdict"): frozenset(Verdict),
    ("changes", "decision"): frozenset(Decision),
    ("changes", "nvdb_type"): frozenset((95, 96)),
    ("nvdb_signs", "nvdb_type"): frozenset((95, 96)),
}


@dataclass(frozen=True, slots=True)
class ExportLayers:
    """What an export is made of: GeoDataFrames in EPSG:25833 with exactly the columns of `COLUMNS`.

    The other layers of the file follow from these (:func:`twin.export.derived_layers.file_layers`).

    Attributes
    ----------
    changes : GeoDataFrame of Point
        A finding a row. A ``missing`` change sits at NVDB's position, every other one where the sign was
        seen. ``drive_ids`` and ``cameras`` are joined by ",". ``synced_at`` is when NVDB's word on it was
        fetched: its object, or the newest one where NVDB has none. ``software`` and ``config_sha256`` are
        those of the match. ``sign`` is the sign by code and name, ``road`` where it stands, by road reference
        and street; ``comment`` and ``author`` are of the decision; ``crop_face`` and ``crop_wide`` name
        masked pictures by their paths in the export's folder.
    estimates : GeoDataFrame of Point
        An annotated object a row. ``sigma_azimuth_deg`` is the direction of the ellipse's major axis,
        clockwise from true north; ``height_m`` is ellipsoidal, ``height_nn2000_m`` null where no geoid
        model is installed (:mod:`geoloc.earth.heights`); ``flags`` is joined by ";".
    nvdb_signs : GeoDataFrame of Point
        An object of NVDB a row. Where ``own_geometry`` is false the point lies on the road's centre line.
    drives : GeoDataFrame of LineString
        A recorded drive a row.
    belief, roads_to_drive : GeoDataFrame of Point, of LineString
        What is believed of each sign at the newest drive or sync, and roads by what one more drive would
        settle (:mod:`twin.belief`); of a store that was never matched both are empty.

    A geometry that is None, empty or NaN means that the position is not known: the row is exported without
    one.
    """

    changes: gpd.GeoDataFrame
    estimates: gpd.GeoDataFrame
    nvdb_signs: gpd.GeoDataFrame
    drives: gpd.GeoDataFrame
    belief: gpd.GeoDataFrame = field(default_factory=lambda: _empty("belief"))
    roads_to_drive: gpd.GeoDataFrame = field(default_factory=lambda: _empty("roads_to_drive"))


GIVEN = tuple(one.name for one in fields(ExportLayers))
"""The layers that an export is given; the others are derived from them."""


def empty_layers() -> ExportLayers:
    """Make the layers without rows, with the right columns, dtypes and CRS."""
    return ExportLayers(**{name: _empty(name) for name in GIVEN})


def normalised(layers: ExportLayers) -> ExportLayers:
    """Check the layers and bring them to the form that is written.

    Columns in the order and dtype of `COLUMNS`, rows sorted by `KEY`, 2-D geometry, no index. The arguments
    are not changed.

    Raises
    ------
    ExportRefusedError
        A column is missing, unknown, or holds what it must not; an id occurs twice; the CRS is not
        EPSG:25833; a geometry is of the wrong type.
    """
    return ExportLayers(**{name: _normalise(name, getattr(layers, name)) for name in GIVEN})


def data_time(layers: ExportLayers) -> str:
    """Newest moment that the data of normalised layers know, as ``2026-06-10T08:00:00.000Z``.

    An export carries this time instead of the clock's, so that the same data give the same bytes.
    `NO_DATA_TIME` where the layers know no time.
    """
    import pandas as pd

    synced = pd.to_datetime(layers.nvdb_signs["synced_at"], utc=True, errors="coerce", format="ISO8601")
    moments = [layers.drives["ended"].max(), layers.estimates["last_seen"].max(), synced.max()]
    known = [moment for moment in moments if not pd.isna(moment)]
    return max(known).strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z" if known else NO_DATA_TIME


def _empty(name: str) -> gpd.GeoDataFrame:
    import geopandas as gpd
    import pandas as pd

    columns = {column.name: pd.Series([], dtype=column.dtype) for column in COLUMNS[name]}
    return gpd.GeoDataFrame(columns, geometry=gpd.GeoSeries([], crs=EPSG_UTM33), crs=EPSG_UTM33)


def _normalise(name: str, frame: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    import geopandas as gpd

    _check_shape(name, frame)
    values = {column.name: _cast(name, frame[column.name], column) for column in COLUMNS[name]}
    for column, series in values.items():
        allowed = _ALLOWED.get((name, column))
        wrong = set(series.unique()) - allowed if allowed is not None else set()
        if wrong:
            raise ExportRefusedError(
                f"layer {name}: column {column} holds {min(wrong, key=str)}, "
                f"but it must be one of {', '.join(sorted(map(str, allowed or ())))}"
            )
    result = gpd.GeoDataFrame(values, geometry=_flat(name, frame), crs=EPSG_UTM33)
    key = KEY[name]
    twice = result[key][result[key].duplicated()]
    if len(twice):
        raise ExportRefusedError(f"layer {name}: {key} {twice.iloc[0]} occurs more than once")
    return result.sort_values(key, kind="stable", ignore_index=True)


def _check_shape(name: str, frame: gpd.GeoDataFrame) -> None:
    wanted = {column.name for column in COLUMNS[name]}
    present = set(frame.columns) - {frame.geometry.name}
    if missing := sorted(wanted - present):
        raise ExportRefusedError(f"layer {name}: no column {', '.join(missing)}")
    if unknown := sorted(map(str, present - wanted)):
        raise ExportRefusedError(f"layer {name}: unknown column {', '.join(unknown)}")
    epsg = frame.crs.to_epsg() if frame.crs is not None else None
    if epsg != EPSG_UTM33:
        raise ExportRefusedError(
            f"layer {name}: its CRS is {f'EPSG:{epsg}' if epsg else 'not stated'}, not EPSG:{EPSG_UTM33}"
        )


def _cast(layer: str, series: pd.Series[Any], column: Column) -> pd.Series[Any]:
    """Bring a column to its dtype, or say what does not fit."""
    import numpy as np

    try:
        result = _CAST[column.dtype](series)
    except (TypeError, ValueError, OverflowError) as error:
        raise ExportRefusedError(
            f"layer {layer}: column {column.name} is not {column.dtype}: {error}"
        ) from error
    if column.dtype == "float64" and bool(np.isinf(result).any()):
        raise ExportRefusedError(f"layer {layer}: column {column.name} holds an infinite number")
    return result


def _cast_str(series: pd.Series[Any]) -> pd.Series[Any]:
    return series.astype(object).where(series.notna(), "").astype("str")


def _cast_float(series: pd.Series[Any]) -> pd.Series[Any]:
    import numpy as np
    import pandas as pd

    return pd.Series(series.astype("Float64").to_numpy(dtype=np.float64, na_value=np.nan), index=series.index)


def _cast_bool(series: pd.Series[Any]) -> pd.Series[Any]:
    import pandas as pd

    inferred = series.infer_objects()
    # NumPy would call every non-empty string true.
    if len(inferred) and not pd.api.types.is_bool_dtype(inferred):
        raise TypeError("it holds something other than true and false")
    return inferred.astype("bool")


def _cast_time(series: pd.Series[Any]) -> pd.Series[Any]:
    import pandas as pd

    return pd.to_datetime(series, utc=True, format="ISO8601").dt.as_unit("ms")


# By way of Int64, which refuses fractions where int64 would cut them off.
_CAST: dict[str, Callable[[pd.Series[Any]], pd.Series[Any]]] = {
    "str": _cast_str,
    "float64": _cast_float,
    "bool": _cast_bool,
    TIME: _cast_time,
    "Int64": lambda series: series.astype("Int64"),
    "int64": lambda series: series.astype("Int64").astype("int64"),
}


def _flat(name: str, frame: gpd.GeoDataFrame) -> gpd.GeoSeries:
    """Two-dimensional geometry; None where it is empty or has a coordinate that is not finite."""
    import geopandas as gpd
    import numpy as np
    import shapely

    geometry = np.array(frame.geometry.to_numpy(), dtype=object)
    if shapely.has_z(geometry).any():
        geometry = shapely.force_2d(geometry)
    xy, row = shapely.get_coordinates(geometry, return_index=True)
    geometry[row[~np.isfinite(xy).all(axis=1)]] = None
    geometry[shapely.is_empty(geometry)] = None
    kind = shapely.get_type_id(geometry)
    if np.any((kind >= 0) & (kind != _TYPE_ID[GEOMETRY[name]])):
        raise ExportRefusedError(f"layer {name}: a geometry is not a {GEOMETRY[name]}")
    return gpd.GeoSeries(geometry, index=frame.index, crs=EPSG_UTM33)


_TYPE_ID = {"Point": 0, "LineString": 1}
"""GEOS's numbers, as in :func:`shapely.get_type_id`."""
