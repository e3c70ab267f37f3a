"""Surveys in other coordinate systems: stated they are read, unstated they are named and refused."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import Twin
from pyproj import Transformer

from geoloc.earth.heights import ellipsoidal_from_nn2000
from twin.errors import TruthError
from twin.reports.truth import read_truth

Written = Callable[..., Path]


@pytest.fixture
def written(sample: Path, tmp_path: Path) -> Written:
    """The sample's survey in another system, north first where asked for."""

    def write(epsg: int, *, north_first: bool = False, column: bool = False, ids: bool = True) -> Path:
        turn = Transformer.from_crs(25833, epsg, always_xy=True).transform
        path = tmp_path / "survey.csv"
        with (sample / "truth.csv").open() as file, path.open("w") as out:
            out.write("object,easting,northing,epsg\n")
            for row in csv.DictReader(file):
                place = turn(float(row["easting"]), float(row["northing"]))
                east, north = reversed(place) if north_first else place
                name = row["object"] if ids else f"survey-{row['object']}"
                out.write(f"{name},{east:.9f},{north:.9f},{epsg if column else ''}\n")
        return path

    return write


def _adjusted(twin: Twin, *arguments: object) -> tuple[int, float]:
    answer = twin("evaluate", *arguments, "--json")
    assert answer.code == 0, answer.err
    one = answer.json["methods"][0]
    assert one["method"] == "adjusted"
    return one["objects"]["n"], one["objects"]["max"]


@pytest.mark.parametrize("epsg", [25831, 25832, 25836, 4258])
def test_survey_in_a_stated_system_has_the_same_errors(
    twin: Twin, store: Path, sample: Path, written: Written, epsg: int
) -> None:
    """By the option or by a column, the positions are those of the survey in EPSG:25833 to a millimetre."""
    n, largest = _adjusted(twin, sample / "truth.csv", "--store", store)
    for stated in ([written(epsg), "--epsg", epsg], [written(epsg, column=True)]):
        found = _adjusted(twin, *stated, "--store", store)
        assert found == (n, pytest.approx(largest, abs=1e-3))


@pytest.mark.parametrize("ids", [True, False])
@pytest.mark.parametrize("zone", [31, 32, 34, 35, 36])
def test_survey_in_another_zone_is_refused_and_the_zone_named(
    twin: Twin, store: Path, written: Written, zone: int, ids: bool
) -> None:
    """Paired by id or by position: the drive tells in which zone the numbers are."""
    answer = twin("evaluate", written(25800 + zone, ids=ids), "--store", store)
    assert (answer.code, answer.out) == (4, "")
    epsg = f"EPSG:258{zone}"
    assert f"fit as {epsg} (UTM zone {zone}), not as EPSG:25833: say so by --epsg 258{zone}" in answer.err


def test_wrongly_stated_zone_is_named_too(twin: Twin, store: Path, written: Written) -> None:
    """Numbers of zone 33 that are said to be of zone 32."""
    answer = twin("evaluate", written(25833), "--epsg", 25832, "--store", store)
    assert "fit as EPSG:25833 (UTM zone 33), not as EPSG:25832" in answer.err


@pytest.mark.parametrize(
    ("epsg", "north_first", "said"),
    [
        (25833, True, "are swapped, north first: exchange the names of the two columns."),
        (25832, True, "are swapped, north first: exchange the names of the two columns."),
        (4258, False, "are longitude and latitude: say so by --epsg 4258"),
        (4258, True, "are latitude and longitude: say so by --epsg 4258"),
    ],
)
def test_swapped_axes_and_degrees_are_named(
    twin: Twin, store: Path, written: Written, epsg: int, north_first: bool, said: str
) -> None:
    """North before east, and degrees of either order, are told from metres by their size."""
    answer = twin("evaluate", written(epsg, north_first=north_first), "--store", store)
    assert answer.code == 4
    assert said in answer.err


def test_survey_of_another_place_is_refused(twin: Twin, store: Path, sample: Path, tmp_path: Path) -> None:
    """Objects of the same names 300 km north: no error of 300 km is reported as a result."""
    path = tmp_path / "elsewhere.csv"
    path.write_text((sample / "truth.csv").read_text().replace(",7039", ",7339"))
    answer = twin("evaluate", path, "--store", store)
    assert answer.code == 4
    assert "300,0" in answer.err
    assert "A column drive_id tells those of several drives apart." in answer.err


@pytest.mark.parametrize("epsg", [5972, 5973, 5942])
def test_heights_in_nn2000_reach_the_ellipsoid_or_are_refused(tmp_path: Path, epsg: int) -> None:
    """A system that states NN2000 is never taken as ellipsoidal; without heights it is UTM or degrees."""
    lat, lon = 63.42, 10.46
    east, north = Transformer.from_crs(4258, epsg, always_xy=True).transform(lon, lat)
    path = tmp_path / "survey.csv"
    path.write_text(f"object,easting,northing,height\nP01,{east!r},{north!r},\n")
    (plane,) = read_truth(path, epsg=epsg)
    assert (plane.east_m, plane.north_m) == pytest.approx(
        Transformer.from_crs(4258, 25833, always_xy=True).transform(lon, lat), abs=1e-4
    )
    path.write_text(path.read_text().rstrip() + "10.0\n")
    expected = float(ellipsoidal_from_nn2000(lat, lon, 10.0).height_m)
    if math.isfinite(expected):
        assert read_truth(path, epsg=epsg)[0].height_m == pytest.approx(expected, abs=1e-3)
    else:
        with pytest.raises(TruthError, match=rf"EPSG:{epsg} are NN2000.*HREF2018B.*leave the heights out"):
            read_truth(path, epsg=epsg)


def test_heights_in_nn54_are_refused(tmp_path: Path) -> None:
    """No other height system passes for the ellipsoid either."""
    path = tmp_path / "survey.csv"
    path.write_text("object,easting,northing,height\nP01,273036.5,7039178.8,10.0\n")
    with pytest.raises(TruthError, match="EPSG:6173 are in NN54 height"):
        read_truth(path, epsg=6173)


def test_an_object_in_two_places_is_refused_with_both_lines(tmp_path: Path) -> None:
    """No line wins over another; drives may each have their own, and a line may stand twice."""
    path = tmp_path / "survey.csv"
    head = "object,drive_id,easting,northing\nP01,{first},273036.5,7039178.8\nP02,,273000,7039000\n"
    path.write_text(head.format(first="") + "P01,,273036.5,7039180.8\n")
    with pytest.raises(TruthError, match="lines 2 and 4: object P01 stands in two places"):
        read_truth(path)
    path.write_text(head.format(first="one") + "P01,other,273036.5,7039180.8\n")
    assert len(read_truth(path)) == 3
    path.write_text(head.format(first="") + "P01,,273036.5,7039178.8\n")
    assert len(read_truth(path)) == 3


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Objekt;Øst;Nord\nP01;1;2\n", "Objekt is object, Øst is easting, Nord is northing."),
        ("object,latitude,longitude\nP01,1,2\n", r"latitude is northing \(with --epsg 4258\), longitude is"),
        ("object,easting,northing\nP01,,7039178.8\n", "line 2: easting is empty."),
    ],
)
def test_other_names_of_columns_are_told(tmp_path: Path, text: str, said: str) -> None:
    """Who has the columns under names of his own reads what to rename; an empty cell is called so."""
    path = tmp_path / "survey.csv"
    path.write_text(text)
    with pytest.raises(TruthError, match=said):
        read_truth(path)


def test_format_of_figures_without_figures_is_refused(
    twin: Twin, store: Path, sample: Path, tmp_path: Path
) -> None:
    """Else one would wait for figures that do not come; a folder that is missing is made."""
    answer = twin("evaluate", sample / "truth.csv", "--store", store, "--plots-as", "pdf")
    assert answer.code == 2
    assert "name a folder by --plots too" in answer.err
    table = tmp_path / "nowhere" / "e.csv"
    assert twin("evaluate", sample / "truth.csv", "--store", store, "--csv", table).code == 0
    assert table.stat().st_size > 0
