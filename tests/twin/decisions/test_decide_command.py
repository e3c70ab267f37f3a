"""``twin decide``, ``twin explain`` and ``twin match --exit-code`` on the sample."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from annotation_edits import edit_tracks
from command_line import Twin
from qgis_edits import decide_in_qgis

from geoloc.earth.geodesy import geographic_from_utm33
from twin.cli.options import person
from twin.export import FILES
from twin.store.store import Store


@pytest.fixture(autouse=True)
def kari(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever sits at the machine is Kari."""
    monkeypatch.setenv("TWIN_USER", "kari")


def found(twin: Twin, store: Path) -> dict[str, dict[str, Any]]:
    """Match, and return the findings that are not unchanged, by verdict: the sample has one of each."""
    changes = twin("match", "--store", store, "--json").json["changes"]
    return {change["verdict"]: change for change in changes if change["verdict"] != "unchanged"}


def test_match_exits_with_one_while_findings_are_open(twin: Twin, store: Path) -> None:
    """Only if asked, and until every finding is decided; accepted, dismissed and deferred are all decided."""
    assert twin("match", "--store", store).code == 0
    answer = twin("match", "--exit-code", "--store", store, "--json")
    assert (answer.code, answer.json["n_open"]) == (1, 4)
    for verdict, decision in (("new", "accept"), ("missing", "dismiss"), ("moved", "defer")):
        assert twin("decide", decision, "--verdict", verdict, "--store", store).code == 0
        assert twin("match", "--exit-code", "--store", store).code == 1
    assert twin("decide", "accept", "--drive", "trip_trondheim", "--store", store).code == 0
    answer = twin("match", "--exit-code", "--store", store, "--json")
    assert (answer.code, answer.json["n_open"]) == (0, 0)


def test_decide_one_by_one_and_back(twin: Twin, store: Path) -> None:
    """Ids in any order around the decision; the person comes from TWIN_USER or --by; undo takes one back."""
    findings = found(twin, store)
    ids = [findings["new"]["change_id"], findings["moved"]["change_id"]]
    answer = twin("decide", ids[0], "dismiss", ids[1], "--reason", "road works", "--store", store, "--json")
    assert answer.json == {"decided": "dismiss", "change_ids": sorted(ids), "already": []}
    answer = twin("decide", "accept", ids[0], "--by", "ola", "--store", store)
    assert f"1 finding accepted by ola ({ids[0]})." in answer.err
    again = twin("decide", "accept", ids[0], "--by", "ola", "--store", store, "--lang", "nb")
    assert "0 funn godtatt av ola; 1 hadde avgjørelsen fra før." in again.err
    assert twin("decide", "undo", "--store", store, "--json").json["change_ids"] == [ids[0]]
    history = twin("explain", ids[0], "--store", store, "--json").json["history"]
    assert [(e["decision"], e["by"]) for e in history] == [
        ("dismiss", "kari"),
        ("accept", "ola"),
        ("dismiss", "kari"),
    ]
    assert twin("decide", "undo", "2", "--store", store).code == 5


def test_first_digits_of_an_id_are_enough(twin: Twin, store: Path) -> None:
    """As git takes them: at least six, where no other change begins with them."""
    whole = found(twin, store)["new"]["change_id"]
    assert twin("explain", whole[:6], "--store", store).out.splitlines()[1].startswith(f"{whole} is new")
    assert twin("decide", "accept", whole[:6], whole, "--store", store, "--json").json["change_ids"] == [
        whole
    ]
    for command in (("explain", whole[:5]), ("decide", "accept", whole[:5])):
        answer = twin(*command, "--store", store)
        assert (answer.code, f"found no change {whole[:5]}:" in answer.err) == (2, True)


def test_explain_names_its_terms_in_plain_words(twin: Twin, store: Path) -> None:
    """None has the name that matching has for it."""
    told = twin("explain", found(twin, store)["moved"]["change_id"], "--store", store).out
    assert "log_odds" not in told
    assert "nvdb_sigma_m" not in told


def test_decide_in_bulk_says_how_many_and_never_nothing(twin: Twin, store: Path, tmp_path: Path) -> None:
    """A dry run decides nothing; an area selects by place; an empty selection is refused."""
    new = found(twin, store)["new"]
    corners = np.array([(-5, -5), (5, -5), (5, 5), (-5, 5)])
    lat, lon = geographic_from_utm33(corners[:, 0] + new["east_m"], corners[:, 1] + new["north_m"])
    area = tmp_path / "area.geojson"
    area.write_text(json.dumps(shapely.geometry.mapping(shapely.Polygon(np.column_stack([lon, lat])))))
    bulk = ["decide", "accept", "--area", area, "--class", "142", "--since", "2026-06-01", "--store", store]
    answer = twin(*bulk, "--dry-run")
    assert f"Would accept 1 finding ({new['change_id']}); nothing was decided" in answer.err
    assert new["change_id"] in answer.out
    answer = twin(*bulk)
    assert answer.code == 0
    assert f"1 finding accepted by kari ({new['change_id']})." in answer.err
    answer = twin(*bulk)
    assert answer.code == 5
    assert "No open finding fits" in answer.err
    assert twin(*bulk, "--state", "accept").code == 0
    assert twin("decide", "open", *bulk[2:], "--state", "accept", "--json").json["decided"] == "open"
    assert found(twin, store)["new"]["decision"] == "open"


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["accept"],
        ["4567abf7173d"],
        ["accept", "dismiss", "4567abf7173d"],
        ["accept", "4567abf7173d", "--verdict", "new"],
        ["undo", "two"],
        ["undo", "1", "2"],
        ["undo", "--verdict", "new"],
        ["accept", "--from", "x.gpkg"],
        ["accept", "nosuchchange"],
        ["accept", "nosuchchange", "--dry-run"],
        ["accept", "--verdict", "unchanged"],
        ["accept", "--since", "yesterday"],
        ["accept", "--drive", "nosuchdrive"],
        ["accept", "--verdict", "new", "--by", ""],
    ],
)
def test_decide_misunderstood_is_a_usage_error(twin: Twin, store: Path, words: list[str]) -> None:
    """What is not clear, or names what there is not, exits with 2 and decides nothing."""
    assert twin("decide", *words, "--store", store).code == 2
    assert twin("decide", "undo", "--store", store).code == 5


def test_decide_from_a_file_that_was_decided_in_elsewhere(twin: Twin, store: Path, tmp_path: Path) -> None:
    """Either GeoPackage comes back under any name, once, unchanged; a file that is no export is refused."""
    findings = found(twin, store)
    ids = {verdict: finding["change_id"] for verdict, finding in findings.items()}
    twin("export", tmp_path / "out", "--store", store)
    utm33 = Path(shutil.copy(tmp_path / "out" / "twin_utm33.gpkg", tmp_path / "mine.gpkg"))
    wgs84 = Path(shutil.copy(tmp_path / "out" / "twin_wgs84.gpkg", tmp_path / "yours.gpkg"))
    decide_in_qgis(utm33, ids["new"], "accept")
    decide_in_qgis(wgs84, ids["missing"], "dismiss")
    before = utm33.read_bytes()
    for path, change_id in ((utm33, ids["new"]), (wgs84, ids["missing"])):
        assert twin("decide", "--from", path, "--store", store, "--json").json["change_ids"] == [change_id]
        assert twin("decide", "--from", path, "--store", store, "--json").json["change_ids"] == []
    assert utm33.read_bytes() == before
    decided = {verdict: finding["decision"] for verdict, finding in found(twin, store).items()}
    assert decided == {"new": "accept", "missing": "dismiss", "moved": "open", "wrong_type": "open"}
    decide_in_qgis(utm33, ids["moved"], "perhaps")
    assert '"perhaps"' in twin("decide", "--from", utm33, "--store", store).err
    assert twin("decide", "--from", store, "--store", store).code == 5
    assert twin("decide", "--from", tmp_path / "none.gpkg", "--store", store).code == 4


def test_export_does_not_bring_back_what_was_undone(twin: Twin, store: Path, tmp_path: Path) -> None:
    """A decision of QGIS that came home and was taken back stays so when its old file is exported over."""
    new, out = found(twin, store)["new"]["change_id"], tmp_path / "out"
    twin("export", out, "--store", store)
    decide_in_qgis(out / "twin_utm33.gpkg", new, "dismiss")
    assert twin("decide", "--from", out / "twin_utm33.gpkg", "--store", store).code == 0
    assert twin("decide", "undo", "--store", store).code == 0
    assert twin("export", out, "--store", store).code == 0
    assert found(twin, store)["new"]["decision"] == "open"
    decide_in_qgis(out / "twin_utm33.gpkg", new, "dismiss")
    assert twin("export", out, "--store", store).code == 0
    assert found(twin, store)["new"]["decision"] == "dismiss"


def test_dismissed_finding_comes_back_when_the_drive_shows_something_else(
    twin: Twin, synced: Path, trip: Path
) -> None:
    """Ingested again as it was it stays dismissed; with another sign code seen it is open and says why."""
    ingest = ["ingest-drive", trip, "--method", "single-frame", "--store", synced]
    assert twin(*ingest).code == 0
    first = found(twin, synced)
    for verdict in ("wrong_type", "new"):
        change_id = first[verdict]["change_id"]
        assert twin("decide", "dismiss", change_id, "--store", synced).code == 0
    assert twin(*ingest).code == 0
    assert twin("decide", "undo", "--store", synced).code == 0
    assert found(twin, synced)["wrong_type"]["decision"] == "dismiss"
    edit_tracks(trip, lambda track: track.replace(">362.50<", ">362.30<"))
    assert twin(*ingest).code == 0
    changes = twin("match", "--store", synced, "--json").json["changes"]
    plate = first["wrong_type"]["nvdb_id"]
    (again,) = (c for c in changes if c["verdict"] == "wrong_type" and c["nvdb_id"] == plate)
    assert again["decision"] == "open"
    assert re.search(
        r"Dismissed \d{4}-\d\d-\d\d by kari; since then the sign code seen changed from 362.50 to 362.30",
        again["reason"],
    )
    told = twin("explain", again["change_id"], "--store", synced).out.replace("\n", " ")
    assert again["reason"].partition("Dismissed")[2] in told


def test_whole_rerun_with_nothing_new_changes_nothing(
    twin: Twin, sample: Path, nvdb_url: str, store: Path, tmp_path: Path
) -> None:
    """Syncs by changes and in full, the same drive, match and export: byte-identical files."""
    twin("decide", "dismiss", "--verdict", "new", "--store", store)
    twin("export", tmp_path / "a", "--store", store)
    for again in (
        ["sync-nvdb", "--api-url", nvdb_url],
        ["sync-nvdb", "--api-url", nvdb_url, "--fresh"],
        ["ingest-drive", sample / "trip_trondheim"],
        ["match"],
        ["export", tmp_path / "b"],
    ):
        assert twin(*again, "--store", store).code == 0
    for name in FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


@pytest.mark.file
def test_person_is_the_login_name(monkeypatch: pytest.MonkeyPatch, opened: Store) -> None:
    """Without --by and TWIN_USER the system says who it is."""
    monkeypatch.setenv("LOGNAME", "ola")
    assert (person(None, opened), person("kari", opened)) == ("ola", "kari")
