"""From a moving frame to EUREF89: the same shift as PROJ's own, and never a silent null.

With Kartverket's grids: ``tests/real/test_grids.py``.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from pyproj import CRS
from pyproj.exceptions import CRSError
from pyproj.transformer import TransformerGroup

from geoloc.earth import datum
from geoloc.earth.datum import DATUMS, euref89_from_itrf
from geoloc.earth.geodesy import enu_offset, inverse
from geoloc.errors import GeolocError

EPSG = {"ITRF2014": "EPSG:7912", "ITRF2020": "EPSG:9989"}
OFFICIAL_M = {"ITRF2014": (-0.508, -0.670, -0.160), "ITRF2020": (-0.510, -0.667, -0.160)}
"""East, north and up in Trondheim (63.42°N 10.40°E, 80 m) at 2026.9, computed with Kartverket's grids."""


@pytest.fixture
def gridless() -> None:
    """Skip where somebody has installed the grids: then they are used."""
    if datum._by_grids("ITRF2020") is not None:
        pytest.skip("the NKG2020 grids are installed on this machine")


@pytest.mark.usefixtures("gridless")
@pytest.mark.parametrize("frame", DATUMS)
def test_euref89_without_grids_is_near_the_official_shift(frame: str) -> None:
    """Trondheim 2026.9: 4.5 cm horizontally and 12 cm vertically from the NKG2020 grids, and it says so."""
    moved = euref89_from_itrf(frame, 63.42, 10.40, 80.0, 2026.9)
    east, north = enu_offset(63.42, 10.40, moved.latitude_deg, moved.longitude_deg)
    official = OFFICIAL_M[frame]
    assert math.hypot(east - official[0], north - official[1]) < 0.046
    assert moved.height_m - 80.0 == pytest.approx(official[2], abs=0.125)
    assert (moved.extra_sigma_m, moved.extra_sigma_up_m) == (0.045, 0.12)
    assert moved.how.startswith(f"Positions brought from {frame} to EUREF89 without grids")


@pytest.mark.usefixtures("gridless")
@pytest.mark.parametrize("frame", DATUMS)
def test_euref89_without_grids_agrees_with_proj(frame: str) -> None:
    """PROJ's own database route by ETRF2000 gives the same coordinates, where it knows the frame."""
    try:
        group = TransformerGroup(CRS(EPSG[frame]), CRS("EPSG:7931"), always_xy=True, allow_ballpark=False)
    except CRSError:
        pytest.skip(f"this PROJ database does not know {frame}")
    lon, lat, height, _ = group.transformers[0].transform(10.4, 63.42, 80.0, 2024.3)
    ours = euref89_from_itrf(frame, 63.42, 10.4, 80.0, 2024.3)
    np.testing.assert_allclose(ours[:2], (lat, lon), rtol=0, atol=1e-11)
    # A height comes out of geocentric coordinates of 6e6 m.
    assert ours.height_m == pytest.approx(height, abs=1e-8)


def test_euref89_of_the_two_frames_differ_by_millimetres() -> None:
    """ITRF2014 and ITRF2020 lie 4 mm apart in Norway: the same place comes out of either."""
    a, b = (euref89_from_itrf(frame, 63.42, 10.40, 80.0, 2026.9) for frame in DATUMS)
    _, apart = inverse(a.latitude_deg, a.longitude_deg, b.latitude_deg, b.longitude_deg)
    assert 0.0 < apart < 0.006


@pytest.mark.parametrize("frame", DATUMS)
def test_euref89_grows_with_the_epoch(frame: str) -> None:
    """Norway drifts 2.7 cm a year against ITRF: the epoch is used, row by row."""
    moved = euref89_from_itrf(frame, 63.42, 10.40, 80.0, [2010.0, 2026.9])
    _, shift = inverse(63.42, 10.40, moved.latitude_deg, moved.longitude_deg)
    assert (shift[1] - shift[0]) / 16.9 == pytest.approx(0.027, abs=0.006)


def test_euref89_keeps_nan_rows_apart() -> None:
    """A NaN in any argument is NaN in all three coordinates and does not stop the others."""
    nan = np.nan
    moved = euref89_from_itrf(
        "ITRF2020", [63.42, nan, 63.4], 10.4, [80.0, 80.0, nan], [2024.0, 2024.0, 2024.0]
    )
    for values in moved[:3]:
        assert np.isnan(values).tolist() == [False, True, True]


def test_euref89_of_nothing_is_nothing() -> None:
    """A drive without a fix is no error here."""
    none = np.zeros(0)
    assert euref89_from_itrf("ITRF2014", none, none, none, none).latitude_deg.shape == (0,)


def test_euref89_does_not_change_its_arguments() -> None:
    """PROJ may work in place: on copies."""
    lat, height = np.array([63.42, 63.43]), np.array([80.0, 81.0])
    euref89_from_itrf("ITRF2020", lat, 10.4, height, 2024.0)
    assert lat.tolist() == [63.42, 63.43]
    assert height.tolist() == [80.0, 81.0]


def test_euref89_refuses_a_shift_that_cannot_be() -> None:
    """An epoch of 1990 (a clock that was never set) moves nothing, and the sentence says so."""
    with pytest.raises(GeolocError, match=r"epoch 1990\.00.*dates are right"):
        euref89_from_itrf("ITRF2020", 63.42, 10.40, 80.0, 1990.0)
    with pytest.raises(GeolocError, match="1 of 2 positions"):
        euref89_from_itrf("ITRF2014", 63.42, 10.40, 80.0, [2024.0, 2200.0])


def test_euref89_refuses_frames_it_does_not_know() -> None:
    """WGS84 is a family of frames: which one is the user's to say."""
    with pytest.raises(GeolocError, match=r"no way from WGS84 .* one of ITRF2014, ITRF2020"):
        euref89_from_itrf("WGS84", 63.42, 10.40, 80.0, 2024.0)
