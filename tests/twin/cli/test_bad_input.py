"""Bad input: one clear sentence with the file and the cure, the right exit code, the store unchanged."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from command_line import Twin

from nvdb.replay import Fault, ReplayServer
from twin.mirror.mirror_tables import StoreMirror
from twin.store import schema
from twin.store.store import Store


def contents(store: Path) -> dict[str, Any]:
    """Everything of a store that anybody sees: not what an interrupted backfill keeps aside to go on with."""
    with Store.open(store) as opened:
        seen = {
            table.name: opened.rows(sa.select(table).order_by(*table.primary_key.columns))
            for table in schema.metadata.sorted_tables
            if not table.name.endswith("_aside")
        }
    seen["meta"] = [row for row in seen["meta"] if row["key"] != "mirror_backfill"]
    return seen


@pytest.mark.parametrize("command", ["status", "match", "export out", "show P01", "explain x", "decide undo"])
def test_an_empty_file_is_no_store_to_read(twin: Twin, tmp_path: Path, command: str) -> None:
    """Commands that only read say so and leave the file empty."""
    path = tmp_path / "twin.db"
    path.touch()
    answer = twin(*command.split(), "--store", path)
    assert (answer.code, "is empty and not a twin store: name another --store." in answer.err) == (4, True)
    assert path.stat().st_size == 0


MISSING = [
    "ingest-drive nowhere",
    "ingest-drive TRIP --terrain nowhere.tif",
    "ingest-drive TRIP --labels nowhere.toml",
    "inspect nowhere",
    "trajectory nowhere --out x.csv",
    "match --settings nowhere.toml",
    "decide --from nowhere.gpkg",
    "decide accept --area nowhere.geojson",
    "evidence --masker nowhere.onnx",
    "annotate nowhere --no-open",
    "qgis nowhere",
    "submit nowhere",
    "submit nowhere/set.xml",
    "evaluate nowhere.csv",
    "calibrate intrinsics nowhere --board checkerboard:9x6:0.08",
    "calibrate intrinsics TRIP --board checkerboard:9x6:0.08 --rig nowhere.json",
    "calibrate extrinsics nowhere --tags nowhere.toml --rig nowhere.json",
    "calibrate diff nowhere nowhere",
    "calibrate coverage nowhere --board checkerboard:9x6:0.08",
    "calibrate print-yard nowhere",
    "calibrate verify nowhere --known nowhere.csv",
    "calibrate verify TRIP --known nowhere.csv",
    "calibrate from-drives --store nowhere.db",
    "fleet work --store nowhere.db",
    "fleet status --store nowhere.db",
    "fleet retry --store nowhere.db",
    "status --store nowhere.db",
    "review --store nowhere.db --no-open",
    "sync-nvdb --kommune 5001 --store nowhere/twin.db",
    "--log-file nowhere/twin.log status",
]


@pytest.mark.parametrize("as_json", [(), ("--json",)], ids=["text", "json"])
@pytest.mark.parametrize("line", MISSING)
def test_a_missing_file_or_folder_is_bad_data_everywhere(
    twin: Twin,
    store: Path,
    sample: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    line: str,
    as_json: tuple[str, ...],
) -> None:
    """One exit code and one sentence that names it, whichever command asks; with --json it is JSON."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TWIN_STORE", str(store))
    words = [str(sample / "trip_trondheim") if word == "TRIP" else word for word in line.split()]
    if as_json and {"annotate", "review"} & set(words):
        pytest.skip("has no --json")
    before = sorted(tmp_path.iterdir())
    answer = twin(*words, *as_json)
    assert (answer.code, answer.out) == (4, ""), answer.err
    told = answer.error["message"] if as_json else answer.err
    assert "nowhere" in told
    assert answer.err.count("\n") == 1
    assert not as_json or (answer.error["code"], answer.error["kind"]) == (4, "data")
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("line", "code", "kind"),
    [
        ("status --json --frobnicate", 2, "usage"),
        ("match --json --method magic", 2, "usage"),
        ("explain nothing --json", 2, "usage"),
        ("sync-nvdb --kommune 5001 --json --api-url http://127.0.0.1:9", 3, "network"),
        ("sync-nvdb --fylke 50 --json", 5, "refused"),
        ("calibrate wheels --json", 2, "usage"),
    ],
)
@pytest.mark.usefixtures("no_waiting")
def test_errors_under_json_are_json(
    twin: Twin, store: Path, nvdb_url: str, monkeypatch: pytest.MonkeyPatch, line: str, code: int, kind: str
) -> None:
    """One line on stderr: code, kind and sentence. Nothing on stdout, where only results belong."""
    monkeypatch.setenv("TWIN_STORE", str(store))
    monkeypatch.setenv("TWIN_API_URL", nvdb_url)
    answer = twin(*line.split())
    assert (answer.code, answer.out) == (code, "")
    assert (answer.error["code"], answer.error["kind"]) == (code, kind)
    assert answer.err.count("\n") == 1


def test_a_fault_in_twin_is_json_too() -> None:
    """After the traceback, which a report needs, comes the line that programs read."""
    code = (
        "import sys, twin.cli\n"
        "import twin.reports.store_status as held\n"
        "held.status = lambda store: 1 / 0\n"
        "twin.cli.main(['status', '--store', sys.argv[1], '--json'])"
    )
    path = Path(tempfile.mkdtemp()) / "twin.db"
    Store.open(path).close()
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], check=False, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (1, "")
    told = json.loads(done.stderr.splitlines()[-1])["error"]
    assert (told["code"], told["kind"]) == (1, "bug")
    assert "ZeroDivisionError" in done.stderr.splitlines()[-2]


@pytest.mark.usefixtures("no_waiting")
@pytest.mark.parametrize("fault", ["start", "second page"])
def test_a_first_sync_that_fails_leaves_a_store_only_if_it_kept_something(
    twin: Twin, sample: Path, tmp_path: Path, fault: str
) -> None:
    """No empty store is left; where pages have come, the next sync goes on with them."""
    store = tmp_path / "twin.db"
    late = lambda r: "start" in r.query or r.path.endswith("/96")  # noqa: E731
    bad = Fault("status", status=503)
    with ReplayServer(
        sample / "nvdb", faults=lambda r: bad if fault == "start" or late(r) else None
    ) as server:
        answer = twin("sync-nvdb", "--kommune", "5001", "--api-url", server.url, "--store", store)
    assert answer.code == 3
    if fault == "start":
        assert not list(tmp_path.iterdir())
    else:
        with Store.open(store, create=False) as opened:
            assert StoreMirror(opened).backfill() is not None


@pytest.mark.parametrize("contact", ["kari", "kari@", "@kommune.no", "kari@kommune", "kari nordmann@x.no"])
@pytest.mark.parametrize("command", ["sync-nvdb --kommune 5001", "sync-nvdb --kommune 5001 --dry-run"])
def test_a_contact_that_reaches_nobody_is_refused(
    twin: Twin, nvdb_url: str, tmp_path: Path, command: str, contact: str
) -> None:
    """NVDB's staff need an address; nothing is asked, and no store is made."""
    options = ["--contact", contact, "--api-url", nvdb_url, "--store", tmp_path / "twin.db"]
    answer = twin(*command.split(), *options)
    assert (answer.code, "is neither an e-mail address nor a web address" in answer.err) == (2, True)
    assert not list(tmp_path.iterdir())


NETWORK_FAULTS = [
    Fault("html_200"),
    Fault("status", status=503),
    Fault("status", status=404, body=b"nothing here"),
    Fault("truncate"),
    Fault("disconnect"),
    Fault("garbage"),
]


@pytest.mark.usefixtures("no_waiting")
@pytest.mark.parametrize("fault", NETWORK_FAULTS, ids=lambda f: f"{f.kind}{f.status}")
def test_bad_api_exits_with_3_and_leaves_the_store(
    twin: Twin, store: Path, sample: Path, fault: Fault
) -> None:
    """An API that fails on its second page leaves the old mirror, whole."""
    before = contents(store)
    with ReplayServer(sample / "nvdb", faults=lambda r: fault if "start" in r.query else None) as server:
        arguments = ["sync-nvdb", "--kommune", "5001", "--api-url", server.url, "--store", store]
        answer = twin(*arguments, "--json")
    assert answer.code == 3, answer.err
    assert len(answer.err.strip().splitlines()) == 1, answer.err
    assert contents(store) == before


@pytest.mark.usefixtures("no_waiting")
def test_retries_are_told(twin: Twin, store: Path, sample: Path) -> None:
    """A wait without a word looks like a hang: each failed attempt is said, and the sync goes on."""
    with ReplayServer(
        sample / "nvdb", faults=[Fault("status", status=503), None, Fault("html_200")]
    ) as server:
        answer = twin("sync-nvdb", "--kommune", "5001", "--api-url", server.url, "--store", store)
    assert answer.code == 0
    assert answer.err.count("Trying again in") == 2


@pytest.mark.usefixtures("no_waiting")
def test_unreachable_api_names_the_address(twin: Twin, store: Path) -> None:
    """Nobody listens: the message says where and what to check."""
    with ReplayServer({95: [], 96: []}) as server:
        url = server.url
    answer = twin("sync-nvdb", "--kommune", "5001", "--api-url", url, "--store", store)
    assert answer.code == 3
    assert url.removeprefix("http://") in answer.err


def test_another_area_is_refused_unless_replaced(twin: Twin, store: Path, nvdb_url: str) -> None:
    """A mirror of another area is not thrown away by accident."""
    before = contents(store)
    arguments = ["sync-nvdb", "--bbox", "0,6500000,1000,6501000", "--api-url", nvdb_url, "--store", store]
    answer = twin(*arguments)
    assert answer.code == 5
    assert "kommune 5001" in answer.err
    assert contents(store) == before
    assert twin(*arguments, "--replace", "--json").json["skiltpunkt"] == 0


def test_newer_store_is_refused(twin: Twin, store: Path, trip: Path) -> None:
    """Every command refuses a store that a newer twin wrote."""
    with Store.open(store) as opened, opened.transaction() as connection:
        connection.execute(
            sa.update(schema.meta).where(schema.meta.c.key == "schema_version").values(value="999")
        )
    for command in (["status"], ["match"], ["ingest-drive", trip]):
        answer = twin(*command, "--store", store)
        assert answer.code == 4
        assert "newer twin" in answer.err


TRUTH_FAULTS = {
    "no such file": None,
    "lacks the column": "object,x,y\nP01,1,2\n",
    "must be numbers": "object,label,easting,northing\nP01,s,abc,7039178\n",
    "not in Norway": "object,label,easting,northing\nP01,s,273036,9039178\n",
    "no rows": "object,label,easting,northing\n",
    "No estimate": "object,label,easting,northing\nnobody,s,271036,7039178\n",
}


@pytest.mark.parametrize("problem", TRUTH_FAULTS)
def test_bad_truth_is_said(twin: Twin, store: Path, tmp_path: Path, problem: str) -> None:
    """A truth file that cannot be used exits with 4 and says why."""
    path = tmp_path / "truth.csv"
    text = TRUTH_FAULTS[problem]
    if text is not None:
        path.write_text(text)
    answer = twin("evaluate", path, "--store", store)
    assert answer.code == 4
    assert ("cannot be read" if text is None else problem) in answer.err


def test_export_onto_a_file_is_refused(twin: Twin, store: Path, tmp_path: Path) -> None:
    """A file where the folder should be is refused with exit code 5, and stays."""
    target = tmp_path / "out"
    target.write_text("mine")
    answer = twin("export", target, "--store", store)
    assert answer.code == 5
    assert target.read_text() == "mine"
