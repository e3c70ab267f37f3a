"""From the store to the folder and back: decisions made in QGIS come home with the next export."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import pytest
import shapely
import sqlalchemy as sa
from qgis_edits import decide_in_qgis, opened_as_qgis_does
from store_rows import row

from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.earth.heights import nn2000_from_ellipsoidal
from twin.cli import run
from twin.decisions.log import history
from twin.decisions.record import decide
from twin.errors import ExportRefusedError, RefusedError, StoreError
from twin.export import FILES, edited_decisions, export_findings
from twin.export.export import decisions_made_in
from twin.export.folder import GEOJSON, UTM33, WGS84
from twin.export.from_store import layers_from_store
from twin.export.geopackage import Answer
from twin.export.layers import COLUMNS
from twin.ingest.ingest import ingest_drive
from twin.store import frames, schema
from twin.store.store import Store

EAST, NORTH = 270_000.0, 7_041_000.0
METHOD = "single-frame"


def _change(change_id: str, verdict: str = "new") -> dict[str, Any]:
    return row(schema.change, change_id=change_id, verdict=verdict, nvdb_type=95, east_m=EAST, north_m=NORTH)


def _drive(drive_id: str) -> dict[str, Any]:
    line = shapely.LineString([(EAST, NORTH), (EAST + 50.0, NORTH)])
    return row(schema.drive, drive_id=drive_id, name=drive_id, line=shapely.to_wkb(line))


def _estimate(method: str) -> dict[str, Any]:
    values = {"estimate_id": f"e-{method}", "drive_id": "d", "object": "1", "method": method}
    at = {"east_m": EAST, "north_m": NORTH, "cov_ee_m2": 0.04, "cov_nn_m2": 0.01}
    return row(schema.estimate, **values, **at)


def _insert(store: Store, table: sa.Table, *rows: dict[str, Any]) -> None:
    with store.transaction() as connection:
        connection.execute(sa.insert(table), list(rows))
        store.touch(connection)


def _matched(store: Store, changes: Sequence[str], method: str = METHOD) -> None:
    """Leave what a match leaves: these changes and no others, of the store as it is."""
    run = {"method": method, "revision": store.revision()}
    with store.transaction() as connection:
        connection.execute(sa.delete(schema.change))
        if changes:
            connection.execute(sa.insert(schema.change), [_change(name) for name in changes])
        store.put_fact(connection, "last_match", run)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """Return a small store with a drive, estimates by two methods, a sign and two changes."""
    with Store.open(tmp_path / "small.db") as opened:
        _insert(opened, schema.drive, _drive("d"))
        _insert(opened, schema.estimate, _estimate(METHOD), _estimate("paper"))
        _insert(opened, schema.skiltpunkt, row(schema.skiltpunkt, nvdb_id=1, east_m=EAST, north_m=NORTH))
        _matched(opened, ["c-1", "c-2"])
        yield opened


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """Return the folder to export to, which does not exist yet."""
    return tmp_path / "out"


def _decisions(folder: Path) -> dict[str, str]:
    """Read what the three files say, which must be the same."""
    said = []
    for name in (UTM33, WGS84):
        frame = pyogrio.read_dataframe(folder / name, layer="changes", read_geometry=False)
        said.append(dict(zip(frame["change_id"], frame["decision"], strict=True)))
    features = json.loads((folder / GEOJSON).read_text(encoding="utf-8"))["features"]
    said.append({feature["id"]: feature["properties"]["decision"] for feature in features})
    assert said[0] == said[1] == said[2]
    return said[0]


def _kept(store: Store) -> dict[str, str]:
    return {row["change_id"]: row["decision"] for row in store.rows(sa.select(schema.decision))}


def test_export_findings_writes_the_layers_of_the_last_match(store: Store, out: Path) -> None:
    """All files appear; the estimates are those of the method that was matched; nobody has decided."""
    assert [path.name for path in export_findings(store, out).files] == list(FILES)
    rows_of = {"changes": 2, "moves": 0, "nvdb_signs": 1, "estimates": 1, "ellipses": 1, "drives": 1}
    for layer, rows in rows_of.items():
        assert pyogrio.read_info(out / UTM33, layer=layer)["features"] == rows
    estimates = pyogrio.read_dataframe(out / UTM33, layer="estimates")
    assert list(estimates["method"]) == [METHOD]
    assert _decisions(out) == {"c-1": "open", "c-2": "open"}


def test_layers_from_store_say_where_changes_come_from(store: Store) -> None:
    """Cameras, when NVDB's word was fetched, and the match; the newest word where NVDB has no such object."""
    for nvdb_id, day in ((2, "01"), (3, "09")):
        fetched = f"2026-06-{day}T08:00:00Z"
        plate = row(schema.skiltplate, nvdb_id=nvdb_id, east_m=EAST, north_m=NORTH, synced_at=fetched)
        _insert(store, schema.skiltplate, plate)
    known = {**_change("c-3"), "nvdb_id": 2, "cameras": "C1,C3"}
    run = {"settings": {"software": "nvdb-twin 1.2.3"}, "config_sha256": "ab" * 32}
    with store.transaction() as connection:
        connection.execute(sa.insert(schema.change), [known])
        store.put_fact(connection, "last_match", run)
    changes = layers_from_store(store, METHOD).changes.set_index("change_id")
    assert changes["cameras"].to_dict() == {"c-1": "", "c-2": "", "c-3": "C1,C3"}
    assert changes["synced_at"].str[8:10].to_dict() == {"c-1": "09", "c-2": "09", "c-3": "01"}
    assert set(changes["software"]) == {"nvdb-twin 1.2.3"}
    assert set(changes["config_sha256"]) == {"ab" * 32}


def test_layers_from_store_carry_both_heights(store: Store) -> None:
    """NN2000 is what the geoid model makes of the ellipsoidal height: null where it is not installed."""
    estimates = layers_from_store(store, METHOD).estimates
    lat, lon = geographic_from_utm33(EAST, NORTH)
    expected = nn2000_from_ellipsoidal(lat, lon, estimates["height_m"].to_numpy()).height_m
    np.testing.assert_array_equal(estimates["height_nn2000_m"].to_numpy(), expected)


def test_export_command_says_once_that_the_geoid_model_is_missing(
    store: Store, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever reads null heights has been told why, on stderr, and only where it is so."""
    assert run(["export", str(out), "--store", str(store.path)]) == 0
    told = "".join(capsys.readouterr().err.split()).count("HREF2018Bisnotinstalled")
    assert told == int(np.isnan(nn2000_from_ellipsoidal([], [], []).sigma_m))


def test_export_findings_without_a_drive_is_an_error(tmp_path: Path, out: Path) -> None:
    """A store without drives has nothing to export; nothing is written."""
    with (
        Store.open(tmp_path / "new.db") as store,
        pytest.raises(StoreError, match=r"nothing to export yet: run `twin ingest-drive` first\.$"),
    ):
        export_findings(store, out)
    assert not out.exists()


def test_export_findings_older_than_the_store_is_refused(store: Store, out: Path) -> None:
    """After a sync or an ingest the old findings are not exported; after a new match they are."""
    _insert(store, schema.drive, _drive("another"))
    with pytest.raises(RefusedError, match=r"small\.db has changed since .*: run `twin match` again"):
        export_findings(store, out)
    assert not out.exists()
    _matched(store, ["c-1"])
    assert export_findings(store, out).files[0].exists()


@pytest.mark.parametrize("file", [UTM33, WGS84])
def test_decisions_made_in_qgis_come_home_with_the_next_export(store: Store, out: Path, file: str) -> None:
    """A decision in either GeoPackage is kept in the store and stands in all files, no longer an edit."""
    export_findings(store, out)
    decide_in_qgis(out / file, "c-1", "accept")
    told: list[str] = []
    export_findings(store, out, progress=told.append)
    assert told[0] == "keeping 1 decision(s) made in QGIS"
    assert _kept(store) == {"c-1": "accept"}
    assert _decisions(out) == {"c-1": "accept", "c-2": "open"}
    assert edited_decisions(out / UTM33) == edited_decisions(out / WGS84) == {}


def _said(store: Store) -> list[tuple[str, str, str]]:
    """Decision, comment and author of every entry about the first change."""
    return [(entry.decision, entry.reason, entry.by) for entry in history(store.rows, "c-1")]


def test_comment_and_author_come_home_and_stand_in_the_next_export(store: Store, out: Path) -> None:
    """What stands beside a decision is its reason, and who decided; else it is by whom the export names."""
    export_findings(store, out)
    decide_in_qgis(out / UTM33, "c-1", "accept", comment=" no pole left ", author="kari")
    decide_in_qgis(out / UTM33, "c-2", "defer")
    export_findings(store, out, by="ola")
    assert _said(store) == [("accept", "no pole left", "kari")]
    assert [entry.by for entry in history(store.rows, "c-2")] == ["ola"]
    decide_in_qgis(out / WGS84, "c-1", "dismiss")
    export_findings(store, out, by="ola")
    assert _said(store)[1:] == [("dismiss", "", "ola")], "what another person wrote of another decision"
    decide_in_qgis(out / WGS84, "c-1", "dismiss", comment="road works")
    export_findings(store, out, by="ola")
    export_findings(store, out, by="per")
    assert _said(store)[2:] == [("dismiss", "road works", "ola")], "once"
    frame = pyogrio.read_dataframe(out / UTM33, layer="changes").set_index("change_id")
    assert frame.loc["c-1", ["comment", "author"]].tolist() == ["road works", "ola"]


def test_comment_without_a_decision_is_kept_and_decides_nothing(store: Store, out: Path) -> None:
    """A remark on an open finding is in its history; files that contradict each other are refused."""
    export_findings(store, out)
    decide_in_qgis(out / UTM33, "c-1", None, comment="ask Per", author="kari")
    decide_in_qgis(out / WGS84, "c-1", "open", comment="ask Anne")
    with pytest.raises(ExportRefusedError, match=r"open \(ask Per, kari\) and open \(ask Anne\)"):
        export_findings(store, out)
    decide_in_qgis(out / WGS84, "c-1", "open", comment=None)
    export_findings(store, out)
    assert (_said(store), _decisions(out)) == ([("open", "ask Per", "kari")], {"c-1": "open", "c-2": "open"})


def test_decisions_in_files_without_comments_come_home(store: Store, out: Path) -> None:
    """A file of before there were comments, authors, signs and pictures in it is read as it was."""
    export_findings(store, out)
    with opened_as_qgis_does(out / UTM33) as database:
        for column in ("sign", "road", "comment", "author", "crop_face", "crop_wide"):
            database.execute(f"ALTER TABLE changes DROP COLUMN {column}")
        database.execute("UPDATE gpkg_metadata SET metadata = replace(metadata, 'twin_comments', 'x')")
    decide_in_qgis(out / UTM33, "c-1", "accept")
    export_findings(store, out, by="ola")
    assert _said(store) == [("accept", "", "ola")]


def test_decisions_can_be_taken_back_in_qgis(store: Store, out: Path) -> None:
    """A decision set to open again, or cleared, is open in the store and in the files."""
    decide(store, ["c-1"], "accept", by="ola")
    decide(store, ["c-2"], "defer", by="ola")
    export_findings(store, out)
    decide_in_qgis(out / UTM33, "c-1", "open")
    decide_in_qgis(out / UTM33, "c-2", None)
    export_findings(store, out)
    assert _decisions(out) == {"c-1": "open", "c-2": "open"}


def test_decisions_outlive_findings_that_come_and_go(store: Store, out: Path) -> None:
    """A decision on a change that the next match does not find is kept, and is back when the change is."""
    export_findings(store, out)
    decide_in_qgis(out / UTM33, "c-1", "dismiss")
    _matched(store, ["c-2"])
    export_findings(store, out)
    assert _decisions(out) == {"c-2": "open"}
    _matched(store, ["c-1", "c-2"])
    export_findings(store, out)
    assert _decisions(out) == {"c-1": "dismiss", "c-2": "open"}


def test_decisions_agree_or_are_refused(store: Store, out: Path) -> None:
    """The files may say the same, or one of them nothing; where they disagree nothing is kept or written."""
    export_findings(store, out)
    decide_in_qgis(out / UTM33, "c-1", "accept")
    decide_in_qgis(out / WGS84, "c-1", "accept")
    decide_in_qgis(out / WGS84, "c-2", "defer")
    assert decisions_made_in(out) == {"c-1": Answer("accept"), "c-2": Answer("defer")}
    decide_in_qgis(out / WGS84, "c-1", "dismiss")
    before = {name: (out / name).read_bytes() for name in FILES}
    with pytest.raises(
        ExportRefusedError, match=r"disagree about 1 .*change c-1: accept and dismiss\): decide"
    ):
        export_findings(store, out)
    assert _kept(store) == {}
    assert {name: (out / name).read_bytes() for name in FILES} == before


@pytest.mark.parametrize("typed", ["yes", "", "Accept"])
def test_decisions_that_are_none_are_refused(store: Store, out: Path, typed: str) -> None:
    """What was typed in the attribute table and is no decision stays out of the store; the cure is told."""
    export_findings(store, out)
    decide_in_qgis(out / UTM33, "c-2", typed)
    with pytest.raises(ExportRefusedError, match=f'"{typed}" for change c-2: choose one of open, accept'):
        export_findings(store, out)
    assert _kept(store) == {}


def test_decisions_in_a_file_that_is_open_in_qgis_are_waited_for(store: Store, out: Path) -> None:
    """Edits still in QGIS's log are neither taken by halves nor lost: the layer has to be closed first."""
    export_findings(store, out)
    with closing(sqlite3.connect(out / UTM33)) as qgis:
        qgis.execute("PRAGMA journal_mode=WAL")
        qgis.execute("SELECT * FROM changes").fetchall()
        decide_in_qgis(out / UTM33, "c-1", "accept")
        with pytest.raises(ExportRefusedError, match="close the layer in QGIS"):
            export_findings(store, out)
        assert _kept(store) == {}
    export_findings(store, out)
    assert _decisions(out)["c-1"] == "accept"


@pytest.mark.slow
def test_decision_made_while_the_export_runs_is_not_lost(store: Store, out: Path) -> None:
    """An edit saved after the decisions were read stops this export; the next one brings it home."""
    export_findings(store, out)

    def late(message: str) -> None:
        if GEOJSON in message:
            decide_in_qgis(out / UTM33, "c-1", "accept")

    with pytest.raises(ExportRefusedError, match=r"c-1: accept\): run `twin export` again"):
        export_findings(store, out, progress=late)
    export_findings(store, out)
    assert _decisions(out)["c-1"] == "accept"


def test_layers_from_store_are_of_one_moment(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """What another process commits between the reading of two layers is in neither."""
    real = frames.cep95_m

    def meanwhile(covariance: Any) -> Any:
        with Store.open(store.path) as other:
            _insert(other, schema.drive, _drive("late"))
        return real(covariance)

    # Called once, after the changes and the estimates were read and before the drives are.
    monkeypatch.setattr(frames, "cep95_m", meanwhile)
    assert list(layers_from_store(store, METHOD).drives["drive_id"]) == ["d"]
    monkeypatch.undo()
    assert len(layers_from_store(store, METHOD).drives) == 2


@pytest.mark.parametrize(
    ("again", "wanted"), [("ingest", "changed since the last match"), ("match", "was matched again")]
)
def test_export_findings_of_a_store_that_moves_on_is_refused(
    store: Store, out: Path, monkeypatch: pytest.MonkeyPatch, again: str, wanted: str
) -> None:
    """An ingest or a match while the layers are read: no file mixes a match with what it did not see."""
    real = frames.cep95_m

    def meanwhile(covariance: Any) -> Any:
        with Store.open(store.path) as other:
            if again == "ingest":
                _insert(other, schema.drive, _drive("late"))
            else:
                _matched(other, ["c-3"], method="paper")
        return real(covariance)

    monkeypatch.setattr(frames, "cep95_m", meanwhile)
    with pytest.raises(RefusedError, match=wanted):
        export_findings(store, out)
    assert not out.exists()


def test_a_store_without_nvdb_gives_its_positions(tmp_path: Path, sample: Path) -> None:
    """A drive alone: its estimates by the best method, their ellipses, its path, and nothing about NVDB."""
    with Store.open(tmp_path / "alone.db") as store:
        for method in ("paper", "adjusted"):
            ingest_drive(store, sample / "trip_trondheim", method=method)
        report = export_findings(store, tmp_path / "out", project=True)
        placed = store.rows(sa.select(schema.estimate).where(schema.estimate.c.method == "adjusted"))
    assert not report.matched
    assert [path.name for path in report.files] == list(FILES)
    layers = {name: pyogrio.read_dataframe(tmp_path / "out" / UTM33, layer=name) for name in COLUMNS}
    rows = {"changes": 0, "moves": 0, "nvdb_signs": 0, "estimates": 15, "ellipses": 15, "drives": 1}
    assert {name: len(frame) for name, frame in layers.items()} == {**rows, "belief": 0, "roads_to_drive": 0}
    estimates = layers["estimates"].set_index("estimate_id")
    for one in placed:
        point = estimates.geometry[one["estimate_id"]]
        assert (point.x, point.y) == (one["east_m"], one["north_m"])
    assert layers["ellipses"].contains(layers["estimates"].geometry).all()
    assert json.loads((tmp_path / "out" / GEOJSON).read_text())["features"] == []


def test_decisions_in_the_folder_are_not_lost_to_a_store_without_a_match(store: Store, out: Path) -> None:
    """What a person decided in QGIS on another store's findings stops an export of positions alone."""
    export_findings(store, out)
    decide_in_qgis(out / UTM33, "c-1", "accept")
    _insert(store, schema.drive_method, row(schema.drive_method, drive_id="d", method=METHOD))
    with store.transaction() as connection:
        store.drop_fact(connection, "last_match")
        connection.execute(sa.delete(schema.change))
    with pytest.raises(ExportRefusedError, match="this export would lose"):
        export_findings(store, out)
