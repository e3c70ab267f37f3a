"""The file of what is final: a GeoPackage that is whole at every moment, and that runs are added to."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import geopandas as gpd
import pytest
from live_lines import estimate, verdict
from live_senders import until
from pyproj import Transformer

from twin.errors import FileError, RefusedError
from twin.live.check import Standing
from twin.live.estimates import State
from twin.live.keep import Keeper


def rows(path: Path) -> list[tuple[int, str, str]]:
    """Run, id and state of what stands in it."""
    with closing(sqlite3.connect(path)) as database:
        return database.execute("SELECT run, id, state FROM estimates ORDER BY fid").fetchall()


def test_what_is_final_is_in_the_file_a_second_later_and_gdal_reads_it(tmp_path: Path) -> None:
    """Two runs in one file; places in EPSG:25833, an object without a place without one."""
    path = tmp_path / "live.gpkg"
    first = Keeper(path, "a drive")
    first.keep(estimate("P1", State.FINAL))
    until(lambda: rows(path) == [(1, "P1", "final")])
    first.keep(estimate("P2", State.LOST)._replace(latitude_deg=float("nan"), longitude_deg=float("nan")))
    assert first.close(10.0)
    second = Keeper(path, "another drive")
    second.keep(estimate("P1", State.FINAL))
    assert second.close(10.0)
    assert rows(path) == [(1, "P1", "final"), (1, "P2", "lost"), (2, "P1", "final")]
    assert [one.name for one in tmp_path.iterdir()] == ["live.gpkg"]
    layer = gpd.read_file(path, layer="estimates")
    assert layer.crs.to_epsg() == 25833
    grid = Transformer.from_crs(4326, 25833, always_xy=True).transform(10.45, 63.41)
    assert layer.geometry.iloc[0].coords[0] == pytest.approx(grid, abs=1e-3)
    assert layer.geometry.iloc[1] is None
    assert layer["sigma_major_m"].iloc[0] == pytest.approx(0.2)
    runs = gpd.read_file(path, layer="runs")
    assert runs["source"].tolist() == ["a drive", "another drive"]
    assert runs["ended"].notna().all()
    with closing(sqlite3.connect(path)) as database:
        assert database.execute("PRAGMA user_version").fetchone() == (10300,)


@pytest.mark.slow
def test_a_file_that_is_held_is_written_when_it_is_free(tmp_path: Path) -> None:
    """Nothing is lost meanwhile, and it is told of."""
    path = tmp_path / "live.gpkg"
    keeper = Keeper(path, "a drive")
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        keeper.keep(estimate("P1", State.FINAL))
        until(lambda: keeper.state.failing)
        assert keeper.state.waiting == 1
        other.execute("COMMIT")
    until(lambda: rows(path) == [(1, "P1", "final")])
    until(lambda: not keeper.state.failing)
    assert keeper.close(10.0)


def test_other_files_are_refused(tmp_path: Path) -> None:
    """A database of somebody else's, a file that is none, a folder that is not there."""
    other, text = tmp_path / "other.gpkg", tmp_path / "text.gpkg"
    with closing(sqlite3.connect(other)) as database:
        database.execute("CREATE TABLE estimates (id TEXT)")
    text.write_text("This is no database, and long enough to be looked at." * 40)
    before = other.read_bytes()
    with pytest.raises(RefusedError, match=r"other\.gpkg is no file of twin live"):
        Keeper(other, "a drive")
    assert other.read_bytes() == before
    for path in (text, tmp_path / "nowhere" / "live.gpkg"):
        with pytest.raises(FileError, match=f"{path.name} cannot be written"):
            Keeper(path, "a drive")


def test_the_verdicts_of_a_check_are_kept_as_they_stand_last(tmp_path: Path) -> None:
    """One row a sign and run, with what it was before."""
    path = tmp_path / "live.gpkg"
    keeper = Keeper(path, "a drive")
    first = verdict("95:7", Standing.MOVED)
    for one in (first, first._replace(standing=Standing.UNCHANGED, was=Standing.MOVED)):
        keeper.keep(one)
    assert keeper.close(10.0)
    layer = gpd.read_file(path, layer="verdicts")
    assert layer[["id", "verdict", "was", "nvdb_id"]].to_numpy().tolist() == [
        ["95:7", "unchanged", "moved", 7]
    ]
    assert layer.geometry.iloc[0].coords[0] == pytest.approx((270_000.0, 7_040_000.0), abs=1e-3)
