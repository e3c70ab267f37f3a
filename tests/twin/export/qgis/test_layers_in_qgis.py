"""What a user of QGIS sees, told by QGIS itself (tests/qgis_open_layer.py, without a screen)."""

from __future__ import annotations

import dataclasses
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyogrio
import pytest
import shapely
from checkout import ROOT
from pyproj import Proj
from qgis_python import ENVIRONMENT, SYSTEM_PYTHON, need_qgis

from geoloc.locate.combine import SIGMAS_95
from twin.export import COLUMNS, ExportLayers, export_all
from twin.export.appearance import (
    BELIEF_COLOURS,
    DRIVE_COLOUR,
    ESTIMATE_COLOUR,
    MARK,
    MARKS,
    NVDB_COLOUR,
    ROAD_COLOURS,
)
from twin.export.folder import UTM33, WGS84
from twin.export.layers import EPSG_UTM33

pytestmark = pytest.mark.qgis

SCRIPT = ROOT / "tests" / "qgis_open_layer.py"
FILES = {UTM33: "EPSG:25833", WGS84: "EPSG:4326"}
ROWS = {"changes": 7, "moves": 3, "belief": 5, "roads_to_drive": 3}
ROWS |= {"nvdb_signs": 6, "estimates": 5, "ellipses": 5, "drives": 2}


def _open(*triples: tuple[Path, str, Path]) -> list[dict[str, Any]]:
    need_qgis()
    arguments = [str(part) for triple in triples for part in triple]
    done = subprocess.run(
        [SYSTEM_PYTHON, str(SCRIPT), *arguments], capture_output=True, text=True, check=False, env=ENVIRONMENT
    )
    assert done.returncode == 0, done.stderr
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


@pytest.fixture(scope="module")
def opened(
    layers: ExportLayers, tmp_path_factory: pytest.TempPathFactory
) -> dict[tuple[str, str], dict[str, Any]]:
    """Return what QGIS says of every layer in both files."""
    folder: Path = tmp_path_factory.mktemp("qgis")
    # Apart from what was seen, so that there are lines to draw; each category of a style has a feature.
    signs = layers.nvdb_signs.set_geometry(layers.nvdb_signs.geometry.translate(0.0, -6.0))
    wide = layers.estimates.assign(sigma_major_m=3.0, cep95_m=[1.0, 1.0, 1.0, 2.0, 2.0])
    twice = pd.concat([layers.drives, layers.drives.assign(drive_id="b", annotations_complete=False)])
    export_all(dataclasses.replace(layers, nvdb_signs=signs, estimates=wide, drives=twice), folder)
    wanted = [(file, layer) for file in FILES for layer in COLUMNS]
    found = _open(*((folder / file, layer, folder / f"{file}-{layer}.png") for file, layer in wanted))
    return dict(zip(wanted, found, strict=True))


EVERY = pytest.mark.parametrize(("file", "layer"), [(file, layer) for file in FILES for layer in COLUMNS])


@EVERY
def test_qgis_opens_the_layer_with_its_style(
    opened: dict[tuple[str, str], dict[str, Any]], file: str, layer: str
) -> None:
    """QGIS finds the style by itself: CRS, rows, renderer, and an alias for every field."""
    said = opened[file, layer]
    assert said["crs"] == FILES[file]
    assert said["features"] == ROWS[layer]
    assert said["renderer"] == "categorizedSymbol"
    assert said["aliases"] == {"fid": ""} | {column.name: column.label for column in COLUMNS[layer]}
    assert said["errors"] == []


@EVERY
def test_qgis_draws_the_layer_in_its_colours(
    opened: dict[tuple[str, str], dict[str, Any]], file: str, layer: str
) -> None:
    """The picture that QGIS renders has pixels of every colour of the style."""
    colours = {
        "changes": [mark.colour for mark in MARKS],
        "moves": [MARK[name].colour for name in ("unchanged", "moved", "wrong_type")],
        "estimates": [ESTIMATE_COLOUR],
        "ellipses": [ESTIMATE_COLOUR],
        "belief": BELIEF_COLOURS,
        "roads_to_drive": ROAD_COLOURS,
        "nvdb_signs": [NVDB_COLOUR],
        "drives": [DRIVE_COLOUR],
    }[layer]
    pixels = opened[file, layer]["pixels"]
    assert {colour: pixels.get(colour, 0) >= 10 for colour in colours} == dict.fromkeys(colours, True)


@pytest.mark.parametrize("file", FILES)
def test_qgis_categorises_changes_by_verdict(
    opened: dict[tuple[str, str], dict[str, Any]], file: str
) -> None:
    """Each verdict is drawn in its own colour, and any other value has a symbol, too."""
    symbols = opened[file, "changes"]["symbols"]
    assert {name: colours[0] for name, colours in symbols.items() if name} == {
        mark.verdict: mark.colour for mark in MARKS
    }
    assert "" in symbols
    assert opened[file, "changes"]["labels"]


@pytest.mark.parametrize("file", FILES)
def test_qgis_lets_only_answers_be_edited(opened: dict[tuple[str, str], dict[str, Any]], file: str) -> None:
    """The form offers the decision as a list; everything else, in every layer, is read-only."""
    assert opened[file, "changes"]["editable"] == ["decision", "comment", "author"]
    assert opened[file, "changes"]["widgets"]["decision"] == "ValueMap"
    assert all(opened[file, layer]["editable"] == [] for layer in COLUMNS if layer != "changes")


@pytest.mark.parametrize("file", FILES)
def test_qgis_map_tips_tell_the_finding(opened: dict[tuple[str, str], dict[str, Any]], file: str) -> None:
    """Verdict, sign, road, reason and decision, evaluated by QGIS; "<" in a text is no markup."""
    tips = opened[file, "changes"]["map_tips"]
    moved = next(tip for tip in tips if "<b>Moved</b>" in tip)
    assert "362.60 – Fartsgrense, 60 km/t" in moved
    assert "EV6 S1D1 m100, Skjærgårdsveien" in moved
    assert "<img" not in moved
    assert 'Skjærgårdsveien &lt;moved> &amp; "so" on' in moved
    assert any("Defer, kari: Look &lt;again>" in tip for tip in tips)
    sign = opened[file, "nvdb_signs"]["map_tips"][0]
    assert "<b>Skiltpunkt 900000000</b> version 1" in sign
    assert "stated accuracy 10 cm" in sign
    assert "2026-06-10 08:00:00 – 2026-06-10 08:01:00 UTC, 250 m" in opened[file, "drives"]["map_tips"][0]
    assert "σ 3 m × 0.2 m, CEP95 1 m" in opened[file, "estimates"]["map_tips"][0]
    assert "σ 3 m × 0.2 m, CEP95 1 m" in opened[file, "ellipses"]["map_tips"][0]
    assert "<b>Moved</b> &nbsp; 0.25 m ± 0.4 m from NVDB's position" in opened[file, "moves"]["map_tips"][1]


@pytest.mark.slow
def test_qgis_draws_error_ellipses_to_scale_and_turned(layers: ExportLayers, tmp_path: Path) -> None:
    """An ellipse of 20 m by 5 m sigma at azimuth 30° covers what it should on the map, to a pixel or two.

    On the grid its axis lies at 30° minus the convergence, here +4.2°, which PROJ gives independently. The
    shape's second moments are a quarter of its squared half axes.
    """
    import cv2

    east, north = np.array([270_000.0, 270_500.0]), np.array([7_041_000.0, 7_041_000.0])
    estimates = layers.estimates.iloc[:2].assign(
        sigma_major_m=20.0, sigma_minor_m=5.0, sigma_azimuth_deg=30.0
    )
    estimates = estimates.set_geometry(shapely.points(east, north), crs=EPSG_UTM33)
    export_all(dataclasses.replace(layers, estimates=estimates), tmp_path)
    _open((tmp_path / UTM33, "ellipses", tmp_path / "map.png"))

    picture = cv2.imread(str(tmp_path / "map.png"), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    row, column = np.nonzero(picture[:, : picture.shape[1] // 2] < 250)
    west, _, east_end, _ = pyogrio.read_info(tmp_path / UTM33, layer="ellipses", force_total_bounds=True)[
        "total_bounds"
    ]
    metres_per_px = 1.2 * (east_end - west) / picture.shape[1]
    covariance = np.cov(np.stack([column, -row]) * metres_per_px)
    values, vectors = np.linalg.eigh(covariance)
    half_axes_m = 2 * np.sqrt(values)
    azimuth_deg = np.degrees(np.arctan2(vectors[0, 1], vectors[1, 1])) % 180

    longitude, latitude = Proj(EPSG_UTM33)(east[0], north[0], inverse=True)
    convergence = Proj(EPSG_UTM33).get_factors(longitude, latitude).meridian_convergence
    assert convergence == pytest.approx(-4.1, abs=0.1)
    np.testing.assert_allclose(half_axes_m, [5 * SIGMAS_95, 20 * SIGMAS_95], rtol=0, atol=2 * metres_per_px)
    assert azimuth_deg == pytest.approx(30.0 - convergence, abs=0.5)


@pytest.mark.slow
def test_qgis_draws_surer_findings_larger(layers: ExportLayers, tmp_path: Path) -> None:
    """Of two findings for review, squares of 3.2 mm, the one with confidence 0 is drawn at 0.8, 1 at 1.2.

    96 pixels an inch; the white rim covers half its 0.15 mm on each side, and antialiasing up to a pixel.
    """
    import cv2

    review = MARK["review"]
    changes = layers.changes.iloc[:2].assign(verdict="review", confidence=[0.0, 1.0])
    changes = changes.set_geometry(
        shapely.points([270_000.0, 270_500.0], [7_041_000.0, 7_041_000.0]), crs=EPSG_UTM33
    )
    export_all(dataclasses.replace(layers, changes=changes), tmp_path)
    _open((tmp_path / UTM33, "changes", tmp_path / "map.png"))

    picture = cv2.imread(str(tmp_path / "map.png"))
    assert picture is not None
    blue_green_red = [int(review.colour[i : i + 2], 16) for i in (5, 3, 1)]
    drawn = (picture == blue_green_red).all(axis=2).any(axis=0)
    half = picture.shape[1] // 2
    widths_px = np.array([drawn[:half].sum(), drawn[half:].sum()])
    wanted_px = (review.size_mm * np.array([0.8, 1.2]) - 0.15) * 96 / 25.4
    np.testing.assert_allclose(widths_px, wanted_px, rtol=0, atol=1.5)
