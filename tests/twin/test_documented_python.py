"""The Python examples of docs/ run as they stand, on the sample."""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path
from typing import Any

import geopandas
import pytest
import shapely
from checkout import code_block
from command_line import Twin


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run_page(page: str, after: str = "", **instead: str) -> dict[str, Any]:
    """Run the first Python example of a page, or after its heading; returns its names."""
    code = code_block(page, "python", after)
    for old, new in instead.items():
        assert old in code
        code = code.replace(old, new)
    Path("example.py").write_text(code, encoding="utf-8")
    return runpy.run_path("example.py")


def test_whole_job_from_python(sample: Path, nvdb_url: str) -> None:
    """docs/python.md: from the mirror to files and errors."""
    names = run_page(
        "python.md",
        **{
            "https://nvdbapiles.atlas.vegvesen.no": nvdb_url,
            "path/to/trip": str(sample / "trip_trondheim"),
            "truth.csv": str(sample / "truth.csv"),
        },
    )
    assert all(path.exists() for path in names["files"])
    assert names["report"].n_estimates == 15
    assert len(names["errors"].methods) == 1


def test_tables_for_research(matched_store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """docs/python.md: the sure signs as a table, and as a GeoPackage in EPSG:25833."""
    shutil.copy(matched_store, "twin.db")
    names = run_page("python.md", "## Tables for research")
    assert 0 < len(names["sure"]) <= len(names["signs"]) == 15
    assert "sigma_major_m" in capsys.readouterr().out
    layer = geopandas.read_file("signs.gpkg")
    assert (len(layer), layer.crs.to_epsg()) == (len(names["sure"]), 25833)


def test_decisions_from_python(twin: Twin, matched_store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """docs/decisions-and-review.md: select in an area, decide, take back, bring home, explain."""
    Path("demo-out").mkdir()
    shutil.copy(matched_store, "demo-out/demo.db")
    assert twin("export", "demo-out", "--store", "demo-out/demo.db").code == 0
    Path("area.geojson").write_text(shapely.to_geojson(shapely.box(10, 63, 11, 64)), encoding="utf-8")
    names = run_page("decisions-and-review.md")
    assert len(names["every"]) == 16
    assert [one.finding.verdict for one in names["chosen"]] == ["new"]
    assert capsys.readouterr().out.startswith("4567abf7173d is wrong type, ")


def test_pictures_of_findings_from_python(matched_store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """docs/evidence.md: made, listed, and told why there are none: the drive has no pictures."""
    Path("demo-out").mkdir()
    shutil.copy(matched_store, "demo-out/demo.db")
    run_page("evidence.md")
    told = capsys.readouterr().out.splitlines()
    assert (told[0], told[-1]) == ("0", "0")
    assert "has no pictures" in told[1]
