"""The layers that follow from the others: ellipses of the estimates, lines from NVDB's positions."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest
import shapely
from pyproj import Proj

from twin.export.derived_layers import N_VERTICES, ellipses, file_layers, moves
from twin.export.layers import COLUMNS, GEOMETRY, KEY, ExportLayers, empty_layers, normalised

EAST, NORTH = 270_000.0, 7_041_000.0


@pytest.mark.parametrize("filled", [True, False])
def test_file_layers_carry_the_contract(layers: ExportLayers, filled: bool) -> None:
    """Every layer, with rows or without, has its columns in their dtypes, its geometry, and rows in order."""
    frames = file_layers(normalised(layers if filled else empty_layers()))
    assert list(frames) == list(COLUMNS)
    for name, frame in frames.items():
        assert [(c, str(frame[c].dtype)) for c in frame.columns[:-1]] == [
            (column.name, column.dtype) for column in COLUMNS[name]
        ]
        assert frame.crs.to_epsg() == 25833
        assert frame[KEY[name]].is_monotonic_increasing
        assert set(frame.geom_type.dropna()) == ({GEOMETRY[name]} if filled else set())


def test_ellipses_hold_95_percent(layers: ExportLayers) -> None:
    """Of a million draws from an estimate's Gaussian, 95 % lie in its polygon (and 0.2 % of area is cut off).

    The Gaussian is made from sigma and azimuth with PROJ's own convergence; one sigma of the count is 0.02 %.
    """
    estimates = normalised(layers).estimates.iloc[:1].assign(sigma_major_m=4.0, sigma_minor_m=1.0)
    convergence = Proj(25833).get_factors(*Proj(25833)(EAST, NORTH, inverse=True)).meridian_convergence
    azimuth = np.radians(30.0 - convergence)
    axes = np.array([[np.sin(azimuth), np.cos(azimuth)], [np.cos(azimuth), -np.sin(azimuth)]])
    draws = np.random.default_rng(1).normal(size=(1_000_000, 2)) * [4.0, 1.0] @ axes
    polygon = ellipses(estimates).geometry.iloc[0]
    centre = estimates.geometry.iloc[0]
    inside = shapely.contains_xy(polygon, draws[:, 0] + centre.x, draws[:, 1] + centre.y)
    assert len(polygon.exterior.coords) == N_VERTICES + 1
    assert np.mean(inside) == pytest.approx(0.95, abs=0.001)


def test_ellipses_leave_out_what_is_not_known(layers: ExportLayers) -> None:
    """No position or no sigma: no ellipse, and none of the others shifts to another estimate."""
    estimates = layers.estimates.assign(sigma_minor_m=[0.2, np.nan, 0.2, 0.2, 0.2])
    estimates.loc[3, "geometry"] = None
    known = normalised(dataclasses.replace(layers, estimates=estimates)).estimates
    drawn = ellipses(known)
    assert list(drawn["estimate_id"]) == ["e-0", "e-2", "e-4"]
    centres = known.set_index("estimate_id").geometry.loc[drawn["estimate_id"]]
    assert drawn.geometry.centroid.geom_equals_exact(centres.reset_index(drop=True), 1e-6).all()


def test_moves_lead_from_nvdb_to_what_was_seen(layers: ExportLayers) -> None:
    """Only findings of an object of NVDB with a distance and both positions; the line ends at the finding."""
    signs = layers.nvdb_signs.set_geometry(layers.nvdb_signs.geometry.translate(3.0, 4.0))
    checked = normalised(dataclasses.replace(layers, nvdb_signs=signs))
    lines = moves(checked.changes, checked.nvdb_signs)
    # c-03 is new, c-04 and c-05 were not seen, and the mirror has no object 900000006 of c-06.
    assert list(lines["change_id"]) == ["c-00", "c-01", "c-02"]
    assert lines.geometry.length.to_numpy() == pytest.approx([5.0, 5.0, 5.0])
    ends = shapely.get_point(lines.geometry.to_numpy(), -1)
    assert shapely.equals(ends, checked.changes.geometry.to_numpy()[:3]).all()


@pytest.mark.parametrize(("distance_m", "start"), [(7.0, 7.0), (2.0, 2.0)])
def test_moves_start_where_the_distance_was_measured_from(
    layers: ExportLayers, distance_m: float, start: float
) -> None:
    """A plate and its Skiltpunkt that NVDB has in two places: the line is as long as the distance says."""
    base = normalised(layers)
    signs = base.nvdb_signs.iloc[:2].assign(point_id=pd.array([None, 900_000_000], dtype="Int64"))
    signs = signs.set_geometry(shapely.points([EAST + 7.0, EAST + 2.0], [NORTH, NORTH]), crs=25833)
    changes = base.changes.iloc[1:2].assign(distance_m=distance_m)
    changes = changes.set_geometry([shapely.Point(EAST, NORTH)], crs=25833)
    assert moves(changes, signs).geometry.length.tolist() == [start]
