"""Points and directions on the ellipsoid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from geoloc.earth import geodesy

LATITUDE = st.floats(57.0, 72.0)
LONGITUDE = st.floats(4.0, 32.0)
TRONDHEIM = (63.4, 10.4)


def test_direct_solves_textbook_degrees() -> None:
    """On GRS80 one degree along the equator is a·π/180 and the first degree north 110 574.39 m."""
    lat, lon = geodesy.direct(0.0, 10.0, [90.0, 0.0], [math.radians(1.0) * 6_378_137.0, 110_574.3885])
    np.testing.assert_allclose(lat, [0.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(lon, [11.0, 10.0], atol=1e-9)


def test_inverse_knows_the_length_of_the_meridian() -> None:
    """Equator to pole on GRS80 is 10 001 965.729 m (Moritz 2000, doi:10.1007/s001900050278)."""
    azimuth, distance = geodesy.inverse(0.0, 10.0, 90.0, 10.0)
    assert distance == pytest.approx(10_001_965.729, abs=1e-3)
    assert azimuth == pytest.approx(0.0, abs=1e-9)


@given(LATITUDE, LONGITUDE, st.floats(0.0, 359.999), st.floats(0.1, 50_000.0))
def test_direct_and_inverse_undo_each_other(lat: float, lon: float, azimuth: float, distance: float) -> None:
    """A leg's azimuth and length come back from its ends: 1 µm along it and across it."""
    end = geodesy.direct(lat, lon, azimuth, distance)
    azimuth_again, distance_again = geodesy.inverse(lat, lon, *end)
    turn = math.radians((azimuth_again - azimuth + 180.0) % 360.0 - 180.0)
    assert distance_again == pytest.approx(distance, abs=1e-6)
    assert abs(turn) * distance < 1e-6


def test_inverse_gives_azimuths_from_0_to_360() -> None:
    """West is 270°, not -90°."""
    azimuth, _ = geodesy.inverse(60.0, 10.0, 60.0, 9.99)
    assert azimuth == pytest.approx(270.0, abs=0.01)


def test_inverse_haversine_solves_the_textbook_sphere() -> None:
    """One degree of arc on the sphere, north from 60° and east along the equator."""
    degree = math.radians(1.0) * 6_371_000.0
    lat, lon = geodesy.inverse_haversine([60.0, 0.0], [10.0, 10.0], [0.0, 90.0], degree)
    np.testing.assert_allclose(lat, [61.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(lon, [10.0, 11.0], atol=1e-12)


def test_inverse_haversine_overshoots_in_trondheim() -> None:
    """The paper's sphere puts an object 0.25 % too far north or south, 0.38 % too far east or west.

    By hand at 63.4°N: M = 6 386.6 km and N = 6 395.3 km against 6 371 km.
    """
    end = geodesy.inverse_haversine(*TRONDHEIM, [0.0, 90.0, 180.0, 270.0], 20.0)
    _, distance = geodesy.inverse(*TRONDHEIM, *end)
    np.testing.assert_allclose(distance / 20.0 - 1.0, [0.00245, 0.00381, 0.00245, 0.00381], atol=1e-5)


@pytest.mark.parametrize("direct", [geodesy.direct, geodesy.inverse_haversine])
def test_direct_broadcasts_and_answers_nan_with_nan(direct: object) -> None:
    """Any argument may be an array, and a NaN in one element spoils both coordinates of that one alone."""
    assert callable(direct)
    for bad in range(4):
        arguments = [np.full((2, 1), value) for value in (63.4, 10.4, 45.0, 10.0)]
        arguments[bad][0] = np.nan
        lat, lon = direct(*arguments[:3], np.broadcast_to(arguments[3], (2, 3)))
        assert lat.shape == lon.shape == (2, 3)
        assert np.isnan(lat).tolist() == np.isnan(lon).tolist() == [[True] * 3, [False] * 3]


def test_utm33_agrees_with_the_projections_definition() -> None:
    """On the central meridian east is 500 km and north 0.9996 of the meridian's length from the equator."""
    east, north = geodesy.utm33_from_geographic([0.0, 60.0, 63.4], 15.0)
    _, arc = geodesy.inverse(0.0, 15.0, [0.0, 60.0, 63.4], 15.0)
    np.testing.assert_allclose(east, 500_000.0, atol=1e-6)
    np.testing.assert_allclose(north, 0.9996 * arc, atol=1e-4)


@given(LATITUDE, LONGITUDE)
def test_utm33_and_back_closes(lat: float, lon: float) -> None:
    """Every place in Norway comes back from UTM33 to 1e-9°, a tenth of a millimetre."""
    np.testing.assert_allclose(
        geodesy.geographic_from_utm33(*geodesy.utm33_from_geographic(lat, lon)), (lat, lon), rtol=0, atol=1e-9
    )


def test_projection_answers_nan_with_nan_and_never_with_infinity() -> None:
    """NaN and places that the projection does not reach are NaN."""
    lat, lon = np.array([63.4, np.nan, 95.0, np.inf]), np.array([10.4, 10.4, 10.4, 10.4])
    for result in (
        *geodesy.utm33_from_geographic(lat, lon),
        geodesy.grid_convergence_deg(lat, lon),
        geodesy.utm33_scale(lat, lon),
    ):
        assert np.isnan(result).tolist() == [False, True, True, True]
    east, north = geodesy.geographic_from_utm33([270_000.0, np.nan], 7_038_000.0)
    assert np.isnan(east).tolist() == np.isnan(north).tolist() == [False, True]


def test_grid_convergence_in_trondheim_is_minus_4_1_degrees() -> None:
    """10.4°E lies west of the central meridian, so grid north lies west of true north; at 15°E they agree."""
    assert geodesy.grid_convergence_deg(*TRONDHEIM) == pytest.approx(-4.1, abs=0.05)
    assert geodesy.grid_convergence_deg(63.4, 15.0) == pytest.approx(0.0, abs=1e-9)
    assert geodesy.utm33_scale(63.4, 15.0) == pytest.approx(0.9996, abs=1e-9)


@given(LATITUDE, LONGITUDE, st.floats(0.0, 360.0))
def test_grid_azimuth_is_true_azimuth_less_convergence(lat: float, lon: float, azimuth: float) -> None:
    """Ten metres on the ellipsoid, seen on the grid: turned by the convergence and stretched by the scale."""
    start = np.array(geodesy.utm33_from_geographic(lat, lon))
    end = np.array(geodesy.utm33_from_geographic(*geodesy.direct(lat, lon, azimuth, 10.0)))
    grid_azimuth = math.radians(azimuth - float(geodesy.grid_convergence_deg(lat, lon)))
    expected = (
        10.0 * geodesy.utm33_scale(lat, lon) * np.array([math.sin(grid_azimuth), math.cos(grid_azimuth)])
    )
    # The scale changes by 1e-9 a metre; coordinates of 7e6 m carry 1e-9 m.
    np.testing.assert_allclose(end - start, expected, atol=1e-6)


@given(LATITUDE, LONGITUDE, st.floats(0.0, 360.0))
def test_utm33_covariance_turns_with_the_grid(lat: float, lon: float, azimuth: float) -> None:
    """The covariance of a displacement is the outer product of that displacement on the grid."""
    displacement = 10.0 * np.array([math.sin(math.radians(azimuth)), math.cos(math.radians(azimuth))])
    start = np.array(geodesy.utm33_from_geographic(lat, lon))
    on_grid = np.array(geodesy.utm33_from_geographic(*geodesy.direct(lat, lon, azimuth, 10.0))) - start
    covariance = geodesy.utm33_covariance_from_enu(np.outer(displacement, displacement), lat, lon)
    np.testing.assert_allclose(covariance, np.outer(on_grid, on_grid), atol=1e-4)


def test_utm33_covariance_takes_batches() -> None:
    """A round covariance stays round at every place, only scaled by the grid's area."""
    lat, lon = np.array([60.0, 65.0, 70.0]), np.array([5.0, 12.0, 30.0])
    covariance = geodesy.utm33_covariance_from_enu(np.broadcast_to(np.eye(2), (4, 3, 2, 2)), lat, lon)
    scale = geodesy.utm33_scale(lat, lon)
    expected = np.broadcast_to(scale[:, np.newaxis, np.newaxis] ** 2 * np.eye(2), (4, 3, 2, 2))
    np.testing.assert_allclose(covariance, expected, atol=1e-12)


@given(LATITUDE, LONGITUDE, st.floats(-5e3, 5e3), st.floats(-5e3, 5e3))
def test_enu_offset_and_back_closes(lat: float, lon: float, east: float, north: float) -> None:
    """Metres east and north of an origin come back from coordinates to 1 µm."""
    point = geodesy.geographic_from_enu(lat, lon, east, north)
    np.testing.assert_allclose(geodesy.enu_offset(lat, lon, *point), (east, north), rtol=0, atol=1e-6)


def test_enu_offset_keeps_distances_between_points() -> None:
    """Two points 10 km from the origin are as far apart on the local plane as on the ellipsoid, to 1 cm."""
    lat, lon = geodesy.geographic_from_enu(*TRONDHEIM, [0.0, 10_000.0], [10_000.0, 0.0])
    _, distance = geodesy.inverse(lat[0], lon[0], lat[1], lon[1])
    assert distance == pytest.approx(math.sqrt(2.0) * 10_000.0, abs=0.01)


def test_enu_offset_of_the_origin_is_zero() -> None:
    """A point is no distance from itself."""
    np.testing.assert_array_equal(geodesy.enu_offset(*TRONDHEIM, *TRONDHEIM), (0.0, 0.0))


@pytest.mark.parametrize(
    ("angles", "axis", "expected"),
    [
        ((0.0, 0.0, 0.0), "forward", [0.0, 1.0, 0.0]),
        ((90.0, 0.0, 0.0), "forward", [1.0, 0.0, 0.0]),
        ((90.0, 0.0, 0.0), "left", [0.0, 1.0, 0.0]),
        ((0.0, 30.0, 0.0), "forward", [0.0, math.cos(math.pi / 6), -0.5]),
        ((0.0, 0.0, 30.0), "left", [-math.cos(math.pi / 6), 0.0, 0.5]),
        ((0.0, 0.0, 0.0), "up", [0.0, 0.0, 1.0]),
    ],
)
def test_rotation_enu_from_rig_has_the_signs_of_iso_8855(
    angles: tuple[float, float, float], axis: str, expected: list[float]
) -> None:
    """Heading clockwise from north, positive pitch nose down, positive roll left side up."""
    column = ["forward", "left", "up"].index(axis)
    np.testing.assert_allclose(geodesy.rotation_enu_from_rig(*angles)[:, column], expected, atol=1e-15)


def test_rotation_enu_from_rig_agrees_with_scipy() -> None:
    """SciPy composes the same three turns about the axes of the earth, over any batch shape."""
    from scipy.spatial.transform import Rotation

    heading, pitch, roll = np.random.default_rng(3).uniform(-180.0, 180.0, (3, 5, 4))
    angles = np.stack([roll, pitch, 90.0 - heading], axis=-1).reshape(-1, 3)
    expected = Rotation.from_euler("xyz", angles, degrees=True).as_matrix().reshape(5, 4, 3, 3)
    np.testing.assert_allclose(geodesy.rotation_enu_from_rig(heading, pitch, roll), expected, atol=1e-14)


@given(st.floats(-180.0, 180.0), st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_rotation_comes_back_from_its_angles(roll: float, pitch: float, yaw: float) -> None:
    """Angles read from a rotation make that rotation again, straight up and down too."""
    rotation = geodesy.rotation_from_rpy(roll, pitch, yaw)
    again = geodesy.rotation_from_rpy(*geodesy.rpy_from_rotation(rotation))
    np.testing.assert_allclose(again, rotation, rtol=0, atol=1e-11)


def test_functions_of_no_positions_return_none() -> None:
    """Empty arrays come back empty: a drive without a single estimate is no error."""
    none = np.zeros(0)
    for result in (
        geodesy.grid_convergence_deg(none, none),
        geodesy.utm33_scale(none, none),
        *geodesy.utm33_from_geographic(none, none),
        *geodesy.geographic_from_utm33(none, none),
        *geodesy.direct(none, none, none, none),
        *geodesy.inverse(none, none, none, none),
        *geodesy.enu_offset(none, none, none, none),
        *geodesy.geographic_from_enu(none, none, none, none),
    ):
        assert result.shape == (0,)
    assert geodesy.utm33_covariance_from_enu(np.zeros((0, 2, 2)), none, none).shape == (0, 2, 2)


@pytest.mark.parametrize("latitude", [57.0, 60.0, 63.4, 66.0, 69.0, 72.0])
def test_local_form_agrees_with_the_geodesic(latitude: float) -> None:
    """Within 60 m, in all directions, the local form and PROJ's geodesic meet within 0.1 µm, both ways."""
    distance, azimuth = np.meshgrid([0.0, 0.01, 1.0, 20.0, 60.0], np.arange(0.0, 360.0, 5.0))
    east, north = distance * np.sin(np.radians(azimuth)), distance * np.cos(np.radians(azimuth))
    lon, lat, _ = Geod(ellps="GRS80").fwd(
        np.full_like(east, 10.4), np.full_like(east, latitude), azimuth, distance
    )
    found = geodesy.geographic_from_enu(latitude, 10.4, east, north)
    assert geodesy.inverse(lat, lon, *found)[1].max() < 1e-7
    offset = geodesy.enu_offset(latitude, 10.4, lat, lon)
    # A degree's last bit is 1 nm of latitude; differences of degrees carry it.
    np.testing.assert_allclose(offset, (east, north), rtol=0, atol=1e-7)


def test_local_form_hands_over_to_the_geodesic_without_a_step() -> None:
    """On both sides of 100 m, and across the date line, positions are PROJ's to 1 µm."""
    for distance in (99.999, 100.001, 5_000.0):
        lat, lon = geodesy.geographic_from_enu([63.4, -30.0], [10.4, 180.0], [distance] * 2, [0.0, 0.0])
        expected = geodesy.direct([63.4, -30.0], [10.4, 180.0], 90.0, distance)
        assert geodesy.inverse(lat, lon, *expected)[1].max() < 1e-6
        back = geodesy.enu_offset([63.4, -30.0], [10.4, 180.0], *expected)
        np.testing.assert_allclose(back, ([distance] * 2, [0.0, 0.0]), atol=1e-6)


def test_local_form_keeps_nan_rows_apart() -> None:
    """NaN in any argument makes that row NaN in both results and leaves the others alone."""
    arguments = np.tile(np.array([63.4, 10.4, 5.0, 7.0]), (5, 1))
    arguments[range(4), range(4)] = np.nan
    for values in geodesy.geographic_from_enu(*arguments.T):
        np.testing.assert_array_equal(np.isnan(values), [True] * 4 + [False])
