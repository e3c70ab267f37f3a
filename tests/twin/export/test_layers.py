"""The contract of the exported layers."""

from __future__ import annotations

import dataclasses

import geopandas as gpd
import numpy as np
import pandas as pd
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from twin.errors import ExportRefusedError
from twin.export.layers import (
    COLUMNS,
    GIVEN,
    NO_DATA_TIME,
    ExportLayers,
    data_time,
    empty_layers,
    normalised,
)


def _changed(layers: ExportLayers, name: str, **columns: object) -> ExportLayers:
    return dataclasses.replace(layers, **{name: getattr(layers, name).assign(**columns)})


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1))
def test_normalised_does_not_depend_on_the_order_of_rows_and_columns(seed: int) -> None:
    """Shuffling rows and columns changes nothing: an export says the same whatever the query's order."""
    rng = np.random.default_rng(seed)
    n = 6
    values = {
        column.name: pd.Series(rng.integers(0, 9, n)).astype(column.dtype if column.dtype != "bool" else bool)
        for column in COLUMNS["nvdb_signs"]
    } | {"nvdb_id": rng.permutation(n), "nvdb_type": rng.choice([95, 96], n)}
    frame = gpd.GeoDataFrame(values, geometry=gpd.points_from_xy(rng.random(n), rng.random(n)), crs=25833)
    shuffled = frame.sample(frac=1, random_state=rng)[list(rng.permutation(frame.columns))]
    results = [
        normalised(dataclasses.replace(empty_layers(), nvdb_signs=one)).nvdb_signs
        for one in (frame, shuffled)
    ]
    pd.testing.assert_frame_equal(results[0], results[1])


def test_normalised_leaves_its_argument_alone(layers: ExportLayers) -> None:
    """The caller's frames are the same objects with the same content afterwards."""
    before = {name: getattr(layers, name).copy() for name in GIVEN}
    normalised(layers)
    for name, frame in before.items():
        pd.testing.assert_frame_equal(getattr(layers, name), frame)


def test_normalised_drops_height_and_positions_that_are_not_known(layers: ExportLayers) -> None:
    """Geometry is two-dimensional; NaN, infinite and empty points become no geometry, never a default one."""
    points = [
        shapely.Point(1, 2, 3),
        shapely.Point(np.nan, 2),
        shapely.Point(np.inf, 2),
        shapely.Point(),
        None,
    ]
    estimates = layers.estimates.set_geometry(gpd.GeoSeries(points, crs=25833))
    geometry = normalised(dataclasses.replace(layers, estimates=estimates)).estimates.geometry
    assert geometry.iloc[0].wkt == "POINT (1 2)"
    assert geometry.iloc[1:].isna().all()


@pytest.mark.parametrize(
    ("name", "columns", "sentence"),
    [
        ("changes", {"verdict": "gone"}, "column verdict holds gone"),
        ("changes", {"decision": "maybe"}, "column decision holds maybe"),
        ("changes", {"nvdb_type": 97}, "column nvdb_type holds 97"),
        ("changes", {"change_id": "same"}, "change_id same occurs more than once"),
        ("changes", {"n_sightings": 1.5}, "column n_sightings is not int64"),
        ("changes", {"n_sightings": None}, "column n_sightings is not int64"),
        ("changes", {"confidence": "high"}, "column confidence is not float64"),
        ("changes", {"distance_m": np.inf}, "column distance_m holds an infinite number"),
        ("changes", {"colour": "red"}, "unknown column colour"),
        ("nvdb_signs", {"own_geometry": "no"}, "column own_geometry is not bool"),
        ("estimates", {"first_seen": "yesterday evening"}, "column first_seen is not datetime64"),
    ],
)
def test_normalised_refuses_what_breaks_the_contract(
    layers: ExportLayers, name: str, columns: dict[str, object], sentence: str
) -> None:
    """A wrong value is refused with its layer, column and value."""
    with pytest.raises(ExportRefusedError, match=f"^layer {name}: {sentence}"):
        normalised(_changed(layers, name, **columns))


def test_normalised_refuses_a_missing_column(layers: ExportLayers) -> None:
    """A column that is not there is named."""
    with pytest.raises(ExportRefusedError, match="layer drives: no column datum, name"):
        normalised(dataclasses.replace(layers, drives=layers.drives.drop(columns=["name", "datum"])))


@pytest.mark.parametrize(("crs", "said"), [(4326, "EPSG:4326"), (25832, "EPSG:25832"), (None, "not stated")])
def test_normalised_refuses_another_crs(layers: ExportLayers, crs: int | None, said: str) -> None:
    """Only EPSG:25833 is taken, compared by its code."""
    changes = layers.changes.set_crs(crs, allow_override=True)
    with pytest.raises(ExportRefusedError, match=f"layer changes: its CRS is {said}, not EPSG:25833"):
        normalised(dataclasses.replace(layers, changes=changes))


def test_normalised_refuses_the_wrong_geometry(layers: ExportLayers) -> None:
    """A line among the points is refused."""
    points = layers.changes.geometry.copy()
    points.iloc[0] = shapely.LineString([(0, 0), (1, 1)])
    with pytest.raises(ExportRefusedError, match="layer changes: a geometry is not a Point"):
        normalised(dataclasses.replace(layers, changes=layers.changes.set_geometry(points)))


def test_data_time_is_the_newest_moment_of_the_data(layers: ExportLayers) -> None:
    """The drive ended on 10 June, NVDB was fetched on 11 June; without data there is no time."""
    assert data_time(normalised(layers)) == "2026-06-11T09:30:00.000Z"
    unsynced = _changed(layers, "nvdb_signs", synced_at="")
    assert data_time(normalised(unsynced)) == "2026-06-10T08:01:00.500Z"
    assert data_time(empty_layers()) == NO_DATA_TIME
