"""``twin findings``, and ``show``, ``drives`` and ``status`` of every day."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from zipfile import ZipFile

import pytest
from command_line import Twin

from twin.reports.finding_files import COLUMNS
from twin.reports.finding_list import road_written
from twin.store.store import Store
from twin.tables import Table


def _ids(twin: Twin, store: Path, *options: object) -> list[str]:
    answer = twin("findings", "--store", store, "--ids", *options)
    assert answer.code == 0, answer.err
    return answer.out.split()


def test_findings_are_those_of_the_match_that_ask_for_a_decision(twin: Twin, store: Path) -> None:
    """Of every finding that differs from NVDB what `twin match` says of it, with road, kommune and names."""
    matched = {one["change_id"]: one for one in twin("match", "--store", store, "--json").json["changes"]}
    listed = twin("findings", "--store", store, "--json").json
    wanted = {key for key, one in matched.items() if one["verdict"] not in ("unchanged", "not_observable")}
    assert {row["change_id"] for row in listed["rows"]} == wanted
    assert (listed["total"], listed["is_current"]) == (len(wanted), True)
    for row in listed["rows"]:
        one = matched[row["change_id"]]
        assert tuple(row) == COLUMNS
        assert (row["verdict"], row["nvdb_id"]) == (one["verdict"], one["nvdb_id"])
        assert row["east_m"] == pytest.approx(one["east_m"], abs=1e-3)
        assert row["kommune"] == "5001"
        assert row["drives"] == "trip_trondheim"
        assert row["road"].startswith("KV2210 S1D1 m") or row["verdict"] == "new"


def test_findings_fit_every_criterion(twin: Twin, store: Path) -> None:
    """Verdict, state, sign, road, kommune, confidence and text narrow the list, as a person types them."""
    rows = {row["change_id"]: row for row in twin("findings", "--store", store, "--json").json["rows"]}
    by = {row["verdict"]: row["change_id"] for row in rows.values()}
    assert _ids(twin, store, "--verdict", "new", "--verdict", "moved") == [by["new"], by["moved"]]
    assert len(_ids(twin, store, "--verdict", "unchanged")) == 12
    assert _ids(twin, store, "--class", "516") == [by["missing"]]
    assert by["missing"] in _ids(twin, store, "--class", "5")
    assert _ids(twin, store, "--class", "51") == []
    assert by["moved"] in _ids(twin, store, "--road", "kv. 2210 S1D1", "--kommune", 5001)
    assert _ids(twin, store, "--road", "KV22") == _ids(twin, store, "--kommune", 301) == []
    assert _ids(twin, store, "--text", "GANGFELT") == [by["missing"]]
    sure = [key for key, row in rows.items() if row["confidence"] >= 0.99]
    assert sorted(_ids(twin, store, "--min-confidence", 0.99)) == sorted(sure)
    assert set(rows) - set(sure) == set(_ids(twin, store, "--max-confidence", 0.98))
    twin("decide", "defer", by["new"], "--store", store)
    assert _ids(twin, store, "--state", "defer") == [by["new"]]
    assert by["new"] not in _ids(twin, store, "--state", "open")
    assert "no drive nowhere" in twin("findings", "--store", store, "--drive", "nowhere").err


def test_findings_come_in_order_and_page_by_page(twin: Twin, store: Path) -> None:
    """Pages put together are the list; reversed, it is the other way round."""
    for order in ("verdict", "confidence", "road", "distance"):
        every = _ids(twin, store, "--sort", order)
        pages = [_ids(twin, store, "--sort", order, "--limit", 2, "--page", page) for page in (1, 2, 3)]
        assert [one for page in pages for one in page] == every
        assert _ids(twin, store, "--sort", order, "--reverse") == every[::-1]
    surest = twin("findings", "--store", store, "--json", "--sort", "confidence").json["rows"]
    assert [row["confidence"] for row in surest] == sorted((r["confidence"] for r in surest), reverse=True)


def test_page_that_is_not_there_is_told_with_those_that_are(twin: Twin, store: Path) -> None:
    """On a pipe too, where nothing at all would look like no finding."""
    n = len(_ids(twin, store, "--limit", 1000))
    answer = twin("findings", "--store", store, "--limit", 2, "--page", 99)
    assert (answer.code, answer.out) == (0, "")
    assert f"{n} findings fit, on pages 1 to {(n + 1) // 2}." in answer.err


def test_findings_as_files_are_the_same_list(twin: Twin, store: Path, tmp_path: Path) -> None:
    """CSV, CSV for Excel, GeoJSON and a workbook hold each finding once; a pipe has a line for each."""
    rows = twin("findings", "--store", store, "--json", "--lang", "nb").json["rows"]
    files = [tmp_path / name for name in ("f.csv", "f.xlsx", "f.geojson")]
    answer = twin(
        *("findings", "--store", store, "--lang", "nb", "--csv", files[0], "--excel"),
        *("--xlsx", files[1], "--geojson", files[2]),
    )
    assert (answer.code, answer.out) == (0, "")
    table = Table(files[0].read_bytes())
    assert table.delimiter == ";"
    read = list(table.by_name())
    assert [row["reason"] for row in read] == [row["reason"] for row in rows]
    assert [float(table.plain(row["east_m"])) for row in read] == [row["east_m"] for row in rows]
    plain = twin("findings", "--store", store, "--csv", "-").out
    assert [row["change_id"] for row in csv.DictReader(plain.splitlines())] == [r["change_id"] for r in rows]
    features = json.loads(files[2].read_text())["features"]
    assert [f["geometry"]["coordinates"] for f in features] == [
        [row["longitude_deg"], row["latitude_deg"]] for row in rows
    ]
    with ZipFile(files[1]) as book:
        sheet, texts = (
            book.read(f"xl/{name}.xml").decode() for name in ("worksheets/sheet1", "sharedStrings")
        )
    assert sheet.count("<row ") == 1 + len(rows)
    assert "autoFilter" in sheet
    assert "feil skilttype" in texts
    piped = twin("findings", "--store", store).out.splitlines()
    assert [line.split("\t")[0] for line in piped] == [row["change_id"] for row in rows]


@pytest.mark.parametrize(
    ("option", "name", "cure"),
    [("--csv", "f.xlsx", "--xlsx"), ("--xlsx", "f.CSV", "--csv"), ("--geojson", "f.csv", "--csv")],
)
def test_a_file_is_what_its_ending_says(
    twin: Twin, store: Path, tmp_path: Path, option: str, name: str, cure: str
) -> None:
    """An ending of another option is refused with that option; a missing folder is made."""
    answer = twin("findings", "--store", store, option, tmp_path / "new" / name)
    assert (answer.code, f"is written by {cure} {tmp_path / 'new' / name}" in answer.err) == (2, True)
    assert not (tmp_path / "new").exists()
    assert twin("findings", "--store", store, cure, tmp_path / "new" / name).code == 0
    assert (tmp_path / "new" / name).stat().st_size > 0


@pytest.mark.parametrize(
    ("corner", "said"),
    [
        ((63.4, 10.4), "lies outside Norway"),
        ((0.5, 51.5), "lies outside Norway"),
        ((569000.0, 7.0e6), "EPSG:4326"),
    ],
)
def test_an_area_elsewhere_is_told(
    twin: Twin, store: Path, tmp_path: Path, corner: tuple[float, float], said: str
) -> None:
    """Latitude before longitude, another country, metres: refused, not an empty list."""
    x, y = corner
    ring = [[x, y], [x + 0.1, y], [x + 0.1, y + 0.1], [x, y]]
    area = tmp_path / "area.geojson"
    area.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    answer = twin("findings", "--store", store, "--area", area)
    assert (answer.code, said in answer.err) == (2, True), answer.err


def test_nothing_found_is_said_on_a_pipe_too(twin: Twin, store: Path) -> None:
    """Without a terminal, on stderr: what is left out and what to check."""
    answer = twin("findings", "--store", store, "--kommune", 301)
    assert (answer.code, answer.out) == (0, "")
    assert "No finding fits: check --road, --kommune and --class" in answer.err


def test_stale_findings_are_listed_with_a_warning(twin: Twin, store: Path) -> None:
    """After a sync or an ingest the list is that of the last match, and says so; --new needs two matches."""
    assert "There was only one match" in twin("findings", "--store", store, "--new").err
    before = _ids(twin, store)
    with Store.open(store) as opened, opened.transaction() as connection:
        opened.touch(connection)
    answer = twin("findings", "--store", store, "--ids")
    assert (answer.code, answer.out.split()) == (0, before)
    assert "run `twin match` for the findings of now" in answer.err
    assert twin("findings", "--store", store, "--json").json["is_current"] is False


def test_show_takes_a_finding_by_its_first_digits(twin: Twin, store: Path) -> None:
    """Verdict, decision and the estimate behind it; of a sign that was not seen, that it was not."""
    rows = {r["verdict"]: r for r in twin("findings", "--store", store, "--json").json["rows"]}
    moved = rows["moved"]["change_id"]
    shown = twin("show", moved[:6], "--store", store, "--json").json
    assert shown["finding"]["change_id"] == moved
    assert (shown["drive_name"], shown["method"]) == ("trip_trondheim", "adjusted")
    assert shown["east_m"] == pytest.approx(rows["moved"]["east_m"], abs=1.0)
    text = twin("show", moved, "--store", store)
    assert "moved, " in text.out
    assert f"twin explain {moved}" in text.err
    missing = twin("show", rows["missing"]["change_id"], "--store", store)
    assert missing.code == 0
    assert "the sign was not seen" in missing.out
    assert twin("show", "P07", "--store", store, "--json").json["finding"] is None
    nearest = twin("show", moved[:5], "--store", store)
    assert nearest.code == 2
    assert f"perhaps {moved}" in nearest.err


def test_status_and_drives_name_drives_and_count_decisions(twin: Twin, store: Path) -> None:
    """What a person asks in the morning: which drives, how much of them is to decide."""
    before = twin("status", "--store", store, "--json").json
    assert before["decisions"] == {"open": 4, "accept": 0, "dismiss": 0, "defer": 0}
    twin("decide", "accept", "--verdict", "new", "--store", store)
    status = twin("status", "--store", store)
    assert "trip_trondheim (2026-06-10, 498 m)" in status.out
    assert "3 open, 1 accepted" in status.out
    (drive,) = twin("drives", "--store", store, "--json").json
    assert (drive["n_findings"], drive["n_open"], drive["is_matched"]) == (4, 3, True)
    assert drive["objects"] == {"adjusted": 15, "paper": 15, "single-frame": 15}
    assert "2026-06-10 07:59" in twin("drives", "--store", store).out


def test_roads_may_be_written_as_on_signs() -> None:
    """As a Norwegian writes them, and as NVDB does."""
    assert [road_written(text) for text in ("E6", "Fv. 6680 S1D1", "rv3", "KV2210", "Elgeseter gate")] == [
        *("EV6", "FV6680 S1D1", "RV3", "KV2210", "Elgeseter gate")
    ]
