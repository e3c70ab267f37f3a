"""WKT and systems: laws, and hand-worked points."""

from __future__ import annotations

import math

import pyproj
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nvdb.objects import NORWAY_UTM33, Position, in_norway, point_from_wkt, position_from_wkt

steady = settings(
    deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow]
)

easts = st.floats(NORWAY_UTM33[0], NORWAY_UTM33[2])
norths = st.floats(NORWAY_UTM33[1], NORWAY_UTM33[3])
heights = st.floats(-1000, 3000)
places = st.tuples(st.floats(58.5, 69.0), st.floats(5.0, 20.0)) | st.tuples(
    st.floats(69.0, 71.2), st.floats(14.0, 30.0)
)
"""Latitude, longitude: the south and middle of Norway, and Finnmark far outside zone 33."""
numbers = st.floats(allow_nan=False, allow_infinity=False)
tags = st.sampled_from(["POINT Z (", "POINT Z(", "POINTZ(", "point z ( ", " POINT  Z  (\t"])


@steady
@given(numbers, numbers, numbers.filter(lambda z: z != -999999), tags)
def test_wkt_of_three_numbers_is_read_back(x: float, y: float, z: float, tag: str) -> None:
    """Every spelling of POINT Z gives back exactly the numbers that were written."""
    assert point_from_wkt(f"{tag}{x!r} {y!r} {z!r})") == (x, y, z)


@steady
@given(numbers, numbers, st.sampled_from(["POINT(", "POINT (", "Point  ( "]))
def test_wkt_of_two_numbers_has_no_height(x: float, y: float, tag: str) -> None:
    """A point in plan has no height, not height 0."""
    assert point_from_wkt(f"{tag}{x!r} {y!r})") == (x, y, None)


@pytest.mark.parametrize("text", ["-999999", "-999999.0", "-9.99999e5"])
def test_wkt_height_of_minus_999999_is_unknown(text: str) -> None:
    """NVDB's number for an unmeasured height never becomes a height."""
    assert point_from_wkt(f"POINT Z (1 2 {text})") == (1.0, 2.0, None)


def test_wkt_measure_is_not_a_height() -> None:
    """The third number of POINT M is a measure; POINT ZM has both."""
    assert point_from_wkt("POINT M (1 2 3)") == (1.0, 2.0, None)
    assert point_from_wkt("POINT ZM (1 2 3 4)") == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("wkt", "why"),
    [
        ("", "empty"),
        ("POINT EMPTY", "empty"),
        ("POINT Z EMPTY", "empty"),
        ("POINT(NaN 1)", "NaN"),
        ("POINT(1 inf)", "NaN or infinite"),
        ("POINT(1e999 1)", "beyond float64"),
        ("LINESTRING(0 0, 1 1)", "LINESTRING, not a point"),
        ("POINT(1)", "not readable"),
        ("POINT(1 2 3 4 5)", "not readable"),
        ("POINT Z (1 2)", "2 numbers in a POINT Z"),
        ("POINT(1,2)", "not readable"),
        ("POINT(1 2) POINT(3 4)", "not readable"),
        ("270000 7040000", "not readable"),
    ],
)
def test_wkt_that_is_no_point_says_why(wkt: str, why: str) -> None:
    """Empty, NaN, lines and nonsense are refused with a clause that names the reason."""
    with pytest.raises(ValueError, match=why):
        point_from_wkt(wkt)


@steady
@given(st.text(max_size=40))
def test_wkt_of_any_text_is_a_finite_point_or_a_refusal(text: str) -> None:
    """No text gives a coordinate that is not a finite number."""
    try:
        point = point_from_wkt(text)
    except ValueError:
        return
    assert all(math.isfinite(number) for number in point if number is not None)


@steady
@given(easts, norths, heights, st.sampled_from([5973, "5973", "UTM33", 25833, "EPSG:5973"]))
def test_utm33_passes_unchanged(east: float, north: float, height: float, srid: str | int) -> None:
    """The stored form is UTM33: nothing is converted, not even rounded."""
    position, problems = position_from_wkt(f"POINT Z ({east!r} {north!r} {height!r})", srid)
    assert position == Position(east, north, height)
    assert problems == ()


@steady
@given(places, st.sampled_from([(4326, 4326), (5972, 25832), (5975, 25835)]))
def test_every_system_leads_to_the_same_place(place: tuple[float, float], system: tuple[int, int]) -> None:
    """A point written in latitude-longitude, UTM32 or UTM35 is found where UTM33 has it, to 1 mm."""
    (lat, lon), (srid, epsg) = place, system
    east, north = pyproj.Transformer.from_crs(4326, 25833, always_xy=True).transform(lon, lat)
    if epsg == 4326:
        wkt = f"POINT({lat!r} {lon!r})"
    else:
        x, y = pyproj.Transformer.from_crs(4326, epsg, always_xy=True).transform(lon, lat)
        wkt = f"POINT({x!r} {y!r})"
    position, _ = position_from_wkt(wkt, srid)
    # Transverse Mercator far outside a zone closes to well below 1 mm in PROJ's exact algorithm.
    assert math.hypot(position.east_m - east, position.north_m - north) < 1e-3


def _utm33_by_kruger(lat_deg: float, lon_deg: float) -> tuple[float, float]:
    """UTM33 on GRS80 by Krüger's series to n^4 (Karney 2011, equations 7-9, 35), written out here."""
    a, f = 6378137.0, 1 / 298.257222101
    n = f / (2 - f)
    radius = a / (1 + n) * (1 + n**2 / 4 + n**4 / 64)
    alpha = (
        n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180,
        13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440,
        61 * n**3 / 240 - 103 * n**4 / 140,
        49561 * n**4 / 161280,
    )
    lat, lon = math.radians(lat_deg), math.radians(lon_deg - 15.0)
    e = math.sqrt(f * (2 - f))
    tau = math.sinh(math.asinh(math.tan(lat)) - e * math.atanh(e * math.sin(lat)))
    xi = math.atan2(tau, math.cos(lon))
    eta = math.asinh(math.sin(lon) / math.hypot(tau, math.cos(lon)))
    north = xi + sum(k * math.sin(2 * j * xi) * math.cosh(2 * j * eta) for j, k in enumerate(alpha, 1))
    east = eta + sum(k * math.cos(2 * j * xi) * math.sinh(2 * j * eta) for j, k in enumerate(alpha, 1))
    return 500_000.0 + 0.9996 * radius * east, 0.9996 * radius * north


@steady
@given(places)
def test_degrees_agree_with_the_written_out_projection(place: tuple[float, float]) -> None:
    """A 4326 point is placed where Krüger's series, coded independently, places it: within 1 mm."""
    lat, lon = place
    position, _ = position_from_wkt(f"POINT({lat!r} {lon!r})", 4326)
    east, north = _utm33_by_kruger(lat, lon)
    # n^5 is 1e-14 of a quarter meridian and grows with the distance from the zone: below 0.1 mm here.
    assert math.hypot(position.east_m - east, position.north_m - north) < 1e-3


def test_degrees_agree_with_gdal() -> None:
    """63.41495441 N 10.39912884 E is 270416.272 E 7040073.036 N by GDAL 3.6, to 1 mm."""
    position, _ = position_from_wkt("POINT Z (63.41495441 10.39912884 39.9)", 4326)
    assert position.east_m == pytest.approx(270416.272, abs=1e-3)
    assert position.north_m == pytest.approx(7040073.036, abs=1e-3)
    assert position.height_m == 39.9


@pytest.mark.parametrize(
    ("wkt", "srid", "why"),
    [
        ("POINT(7040000 270000)", 5973, "swapped"),
        ("POINT(10.4 63.4)", 4326, "swapped"),
        ("POINT(0 0)", 5973, r"outside Norway \(POINT\(0 0\)\)"),
        ("POINT(0 0)", 4326, "outside Norway"),
        ("POINT(95 10)", 4326, "outside Norway"),
        ("POINT(63.4 10.4)", 5973, "outside Norway"),
        ("POINT(270000 7040000)", 3857, "unknown srid 3857"),
        ("POINT(270000 7040000)", None, "no srid"),
    ],
)
def test_position_outside_norway_says_why(wkt: str, srid: int | None, why: str) -> None:
    """Swapped axes, null island, wrong and unknown systems are refused, never guessed at."""
    with pytest.raises(ValueError, match=why):
        position_from_wkt(wkt, srid)


def test_impossible_height_is_dropped_and_told() -> None:
    """A height of 99999 m is no height; the point in plan stays."""
    position, problems = position_from_wkt("POINT Z (270000 7040000 99999)", 5973)
    assert position == Position(270000.0, 7040000.0, None)
    assert problems == ("the height 99999 m is impossible",)


def test_nan_is_not_in_norway() -> None:
    """A comparison with NaN is never true."""
    assert not in_norway(math.nan, 7_000_000.0)
