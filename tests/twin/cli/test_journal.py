"""``--quiet``, ``--verbose`` and ``--log-file``: who is told what."""

from __future__ import annotations

import datetime as dt
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from command_line import Twin

from nvdb.replay import Fault, ReplayServer
from twin.cli.exit_codes import EXIT_CODES
from twin.cli.journal import without_secrets


def lines(path: Path) -> list[dict[str, Any]]:
    """A log file, read."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


@pytest.mark.usefixtures("no_waiting")
def test_log_file_tells_a_run_from_beginning_to_end(
    twin: Twin, sample: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beginning, retries, warnings and the exit code, in UTC; runs are added; nothing secret is in it."""
    monkeypatch.setenv("TWIN_SKRIV_PASSWORD", "hemmelig")
    log, store = tmp_path / "twin.log", tmp_path / "twin.db"
    bad = iter([Fault("status", status=503, body=b"token=hemmelig")])
    with ReplayServer(sample / "nvdb", faults=lambda _: next(bad, None)) as server:
        options = ["--kommune", "5001", "--api-url", server.url, "--store", store]
        assert twin("--quiet", "--log-file", log, "sync-nvdb", *options).code == 0
    wrong = ["--api-url", "http://kari:hysjhysj@nvdb.no", "--kommune", "5001", "--store", store]
    assert twin("--log-file", log, "sync-nvdb", *wrong).code == 2
    told = lines(log)
    assert all({"time", "level", "command", "process", "what"} <= one.keys() for one in told)
    now = dt.datetime.now(dt.UTC)
    assert all(abs((now - dt.datetime.fromisoformat(one["time"])).total_seconds()) < 600 for one in told)
    assert {one["command"] for one in told} == {"sync-nvdb"}
    assert sum("Trying again in" in one["what"] for one in told) == 1
    assert [one["exit_code"] for one in told if one["what"] == "ended"] == [0, 2]
    assert [one["exit_code"] for one in told if one["level"] == "error"] == [2]
    text = log.read_text(encoding="utf-8")
    assert not [word for word in ("hemmelig", "hysjhysj") if word in text]


def test_verbose_says_what_is_asked_of_nvdb_and_when(twin: Twin, nvdb_url: str, tmp_path: Path) -> None:
    """Each request with its parameters, status and time; without --verbose none of them."""
    options = ["--kommune", "5001", "--api-url", nvdb_url, "--store", tmp_path / "twin.db"]
    loud, plain = twin("--verbose", "sync-nvdb", *options), twin("sync-nvdb", *options)
    asked = [line for line in loud.err.splitlines() if " GET " in line]
    assert any("/vegobjekter/95?" in line and "kommune=5001" in line and ": 200, " in line for line in asked)
    assert all(float(line.split()[0]) >= 0 for line in asked)
    assert "GET" not in plain.err


def test_quiet_tells_changes_only(twin: Twin, sample: Path, nvdb_url: str, tmp_path: Path) -> None:
    """For cron: the first sync and match tell what is new, the same again tells nothing."""
    store = ["--store", tmp_path / "twin.db"]
    sync = ["--quiet", "sync-nvdb", "--kommune", "5001", "--api-url", nvdb_url, *store]
    first = twin(*sync)
    assert (first.out, first.err) == ("NVDB, kommune 5001: 44 new, 0 changed, 0 deleted\n", "")
    assert twin("--quiet", "ingest-drive", sample / "trip_trondheim", *store).out.count("\n") == 1
    match = twin("--quiet", "match", *store)
    assert (match.code, match.err) == (0, "")
    open_before = twin("match", *store, "--json").json["n_open"]
    assert match.out.count(" open ") == open_before > 0
    for again in (sync, ["--quiet", "match", *store]):
        answer = twin(*again)
        assert (answer.code, answer.out, answer.err) == (0, "", "")


def test_progress_is_shown_to_a_terminal_only(sample: Path, store: Path) -> None:
    """On a pipe, as under cron, tables and warnings are printed and no step of the work."""
    command = [sys.executable, "-m", "twin", "match", "--store", str(store)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "assigning" not in done.stderr
    assert done.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_log_file_on_a_full_disk_stops_no_work(twin: Twin, store: Path) -> None:
    """It is said once, and the command does what it was asked for."""
    answer = twin("--log-file", "/dev/full", "status", "--store", store)
    assert answer.code == 0
    assert answer.err.count("The log file /dev/full takes no more") == answer.err.count("\n") == 1


def test_options_of_twin_stand_before_the_command(twin: Twin) -> None:
    """Written after it, they are told where they belong; quiet and verbose together are refused."""
    told = "twin: --quiet stands before the command: `twin --quiet match`.\n"
    assert twin("match", "--quiet").err == told
    assert twin("--quiet", "--verbose", "status").code == 2


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("https://a:b@host/x asked", "https://…@host/x asked"),
        ("https://host/x?token=abc&kommune=5001", "https://host/x?token=…&kommune=5001"),
        ("host/x?client_secret=abc.", "host/x?client_secret=…"),
        ("kari@kommune.no", "kari@kommune.no"),
    ],
)
def test_without_secrets(text: str, shown: str) -> None:
    """Users, passwords and tokens go; the rest of a text stays."""
    assert without_secrets(text) == shown


def test_no_message_shows_what_is_secret(twin: Twin, tmp_path: Path) -> None:
    """An address that is refused is told without its user, password and token."""
    url = "https://kari:hysjhysj@host.no/x?token=abcabc"
    for form in ([], ["--json"]):
        answer = twin("sync-nvdb", "--kommune", "5001", "--api-url", url, "--store", tmp_path / "t.db", *form)
        assert (answer.code, "host.no" in answer.err) == (2, True)
        assert not {"hysjhysj", "abcabc", "kari"} & set(re.findall(r"\w+", answer.err))


def test_exit_codes_are_those_of_the_conventions() -> None:
    """Every code once, each with a word of its own and a sentence."""
    assert [one.code for one in EXIT_CODES] == [0, 1, 2, 3, 4, 5, 6, 130, 141, 143]
    assert len({one.kind for one in EXIT_CODES}) == len(EXIT_CODES)
    assert all(one.meaning.endswith(".") for one in EXIT_CODES)
