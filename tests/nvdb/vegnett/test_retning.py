"""Which way a sign faces, worked by hand, and grid against true north."""

from __future__ import annotations

import numpy as np
import pyproj
import pytest

from nvdb.datakatalog import Ansiktsside
from nvdb.vegnett import facing_azimuth, true_azimuth


@pytest.mark.parametrize(
    ("ansiktsside", "side", "first", "second"),
    [
        (Ansiktsside.MED_METRERINGSRETNING, "", 270.0, np.nan),
        (Ansiktsside.MOT_METRERINGSRETNING, "", 90.0, np.nan),
        (Ansiktsside.TOSIDIG, "H", 270.0, 90.0),
        # Right of a road that is metered to the east is its south side: the road lies north.
        (Ansiktsside.PARALLELT_MOT_VEG, "H", 0.0, np.nan),
        (Ansiktsside.PARALLELT_FRA_VEG, "H", 180.0, np.nan),
        (Ansiktsside.PARALLELT_MOT_VEG, "V", 180.0, np.nan),
        (Ansiktsside.PARALLELT_FRA_VEG, "V", 0.0, np.nan),
        (Ansiktsside.PARALLELT_MOT_VEG, "", np.nan, np.nan),
        (0, "H", np.nan, np.nan),
        (99999, "", np.nan, np.nan),
    ],
)
def test_facing_azimuth_on_a_road_metered_to_the_east(
    ansiktsside: int, side: str, first: float, second: float
) -> None:
    """A face looks against the traffic that reads it, or at and away from the road beside it."""
    faces = facing_azimuth(ansiktsside, 90.0, side)
    assert faces.shape == (2,)
    assert np.array_equal(faces, [first, second], equal_nan=True)


def test_facing_azimuth_works_on_many_plates_and_stays_within_the_circle() -> None:
    """Arrays broadcast, an unknown metering gives NaN, and 360 is written 0."""
    faces = facing_azimuth([2714, 2717, 3698], [[180.0], [-1e-15], [np.nan]])
    assert faces.shape == (3, 3, 2)
    assert faces[0, :, 0].tolist() == [0.0, 180.0, 0.0]
    assert faces[1, 1, 0] == 0.0
    assert np.isnan(faces[2]).all()
    known = faces[np.isfinite(faces)]
    assert ((known >= 0) & (known < 360)).all()


def test_true_azimuth_points_where_a_geodesic_points() -> None:
    """A short step along a grid azimuth has the true azimuth that the geodesic between its ends has.

    Independent of the convergence formula. The tolerance allows for the arc-to-chord correction over 1 km,
    which at 0.6 million metres from the central meridian is about 1" (3e-4 degrees).
    """
    geod = pyproj.Geod(ellps="GRS80")
    to_geographic = pyproj.Transformer.from_crs(25833, 4258, always_xy=True)
    east = np.array([-74_000.0, 262_000.0, 270_000.0, 500_000.0, 1_080_000.0])
    north = np.array([6_617_000.0, 6_650_000.0, 7_040_000.0, 7_500_000.0, 7_870_000.0])
    azimuth = np.array([10.0, 100.0, 350.0, 0.0, 359.0])
    step = 500.0 * np.array([np.sin(np.radians(azimuth)), np.cos(np.radians(azimuth))])
    here = to_geographic.transform(east - step[0], north - step[1])
    there = to_geographic.transform(east + step[0], north + step[1])
    forward, backward, _ = geod.inv(*here, *there)
    # The azimuth turns evenly along so short a line: its middle value is the mean of both ends.
    turned = (np.asarray(backward) + 180.0 - forward + 180.0) % 360.0 - 180.0
    expected = (np.asarray(forward) + turned / 2) % 360.0
    difference = (true_azimuth(azimuth, east, north) - expected + 180.0) % 360.0 - 180.0
    assert np.abs(difference).max() < 5e-4


def test_true_azimuth_subtracts_four_degrees_in_trondheim() -> None:
    """At 10.4°E in zone 33 grid north lies 4.1° east of true north's azimuth scale."""
    assert true_azimuth(90.0, [270_000.0], [7_040_000.0]) == pytest.approx([85.9], abs=0.1)


def test_true_azimuth_of_nothing_known_is_nan() -> None:
    """NaN in any of the three stays NaN and does not disturb the rest."""
    result = true_azimuth([90.0, np.nan, 90.0], [270_000.0, 270_000.0, np.nan], 7_040_000.0)
    assert np.isfinite(result).tolist() == [True, False, False]
