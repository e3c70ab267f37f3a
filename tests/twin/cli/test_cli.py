"""The command line: every command, on the sample, with its exit code."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pyogrio
import pytest
from annotation_edits import without_tracks
from checkout import ROOT
from command_line import Twin
from typer.core import TyperGroup
from typer.main import get_group

from twin.cli.app import app
from twin.cli.exit_codes import exit_code
from twin.cli.findings import FindingVerdict
from twin.store.kinds import QUIET, Verdict
from twin.store.schema import METHODS

README = ROOT / "README.md"


def commands(group: TyperGroup | None = None) -> list[str]:
    """Names of all commands, those of a group with the group's before them: ``calibrate verify``."""
    group = group or get_group(app)
    names = []
    for name in group.list_commands(Any):
        command = group.get_command(Any, name)
        names += [f"{name} {sub}" for sub in commands(command)] if isinstance(command, TyperGroup) else [name]
    return names


@pytest.mark.parametrize("command", commands())
def test_help_of_every_command_has_an_example(twin: Twin, command: str) -> None:
    """Every command explains itself and shows how it is called."""
    answer = twin(*command.split(), "--help")
    assert answer.code == 0
    assert f"Example: twin {command}" in " ".join(answer.out.split())


def test_readme_shows_no_command_that_is_not_there() -> None:
    """README's commands exist; docs/reference/commands.md has every one (test_reference looks)."""
    shown = set(
        re.findall(
            r"^twin ((?:calibrate |fleet )?[\w-]+)", README.read_text(encoding="utf-8"), flags=re.MULTILINE
        )
    )
    assert shown <= set(commands())
    assert len(shown) > 5


def test_readme_is_read_at_one_sitting() -> None:
    """README has at most 1,200 words, and no sentence of more than 30: the rest is in docs/."""
    text = README.read_text(encoding="utf-8")
    assert len(text.split()) <= 1200
    prose = re.sub(r"```.*?```|^(?:\||#|!\[).*?$", "\n\n", text, flags=re.DOTALL | re.MULTILINE)
    sentences = re.split(r"[.:!?;]\W*\s|\n\n|\n- ", re.sub(r"\]\(.*?\)", "", prose))
    assert [sentence for sentence in sentences if len(sentence.split()) > 30] == []


def test_help_imports_nothing_heavy() -> None:
    """`twin --help` loads no geopandas, scipy, cv2, pyproj or sqlalchemy: it answers at once."""
    code = (
        "import sys, contextlib, io\n"
        "from twin.cli import run\n"
        "with contextlib.redirect_stdout(io.StringIO()): run(['--help'])\n"
        "print(sorted({'geopandas', 'scipy', 'cv2', 'pyproj', 'sqlalchemy', 'numpy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_version_is_the_packages(twin: Twin) -> None:
    """`twin --version` says which twin this is."""
    answer = twin("--version")
    assert answer.code == 0
    assert answer.out.startswith("twin ")


def test_sync_needs_exactly_one_area(twin: Twin, tmp_path: Path) -> None:
    """No area, two areas and a nonsense area are usage errors, and no store is made."""
    store = tmp_path / "twin.db"
    for options in ([], ["--kommune", "5001", "--all"], ["--kommune", "trondheim"], ["--bbox", "1,2,3"]):
        answer = twin("sync-nvdb", *options, "--store", store)
        assert answer.code == 2
        assert answer.err.count("\n") == 1
    assert not store.exists()
    (tmp_path / "empty.db").touch()
    assert "Say which signs" in twin("sync-nvdb", "--store", tmp_path / "empty.db").err


def test_whole_job_finds_what_the_sample_was_made_to_hold(
    twin: Twin, sample: Path, store: Path, tmp_path: Path
) -> None:
    """Every verdict of the sample is found at the object it was made for, and nothing else.

    The store has the first drive: the second is what disagrees with it.
    """
    assert twin("ingest-drive", sample / "trip_trondheim_2", "--store", store).code == 0
    assert twin("match", "--store", store).code == 0
    answer = twin("export", tmp_path / "out", "--store", store)
    assert answer.code == 0
    changes = pyogrio.read_dataframe(tmp_path / "out" / "twin_utm33.gpkg", layer="changes")
    found = sorted(
        (c.verdict, c.nvdb_type, None if c.nvdb_id != c.nvdb_id or c.nvdb_id is None else int(c.nvdb_id))
        for c in changes.itertuples()
    )
    with (sample / "expected_changes.csv").open(encoding="utf-8", newline="") as file:
        expected = sorted(
            (row["verdict"], int(row["nvdb_type"]), int(row["nvdb_id"]) if row["nvdb_id"] else None)
            for row in csv.DictReader(file)
        )
    assert sorted(found, key=str) == sorted(expected, key=str)


def test_status_tells_what_the_store_holds(twin: Twin, store: Path) -> None:
    """Counts, area and verdicts come from the store."""
    found = twin("status", "--store", store, "--json").json
    assert found["mirror"]["area"] == "kommune 5001"
    assert (found["skiltpunkt"], found["skiltplate"]) == (20, 24)
    assert len(found["drives"]) == 1
    assert set(found["estimates"]) == set(METHODS)
    assert twin("status", "--store", store).code == 0


def test_evaluate_reports_every_method_and_draws(
    twin: Twin, sample: Path, store: Path, tmp_path: Path
) -> None:
    """On the sample the adjustment beats the single frame, which beats the paper; the figures are written."""
    answer = twin("evaluate", sample / "truth.csv", "--plots", tmp_path / "plots", "--store", store, "--json")
    methods = {m["method"]: m for m in answer.json["methods"]}
    median = {name: method["objects"]["median"] for name, method in methods.items()}
    assert median["adjusted"] < median["single-frame"] < median["paper"]
    assert min(methods[name]["coverage95"] for name in ("adjusted", "single-frame")) >= 0.8
    assert [Path(p).name for p in answer.json["plots"]] == ["error_distance.png", "error_speed.png"]
    assert all(Path(p).stat().st_size > 10_000 for p in answer.json["plots"])


def test_match_and_export_before_their_time_say_what_to_run(twin: Twin, sample: Path, tmp_path: Path) -> None:
    """Commands out of order name the command that is missing."""
    store = tmp_path / "twin.db"
    for arguments, cure in (
        (["match"], "sync-nvdb"),
        (["export", tmp_path / "out"], "sync-nvdb"),
        (["status"], "sync-nvdb"),
    ):
        answer = twin(*arguments, "--store", store)
        assert answer.code == 4
        assert cure in answer.err
    assert twin("ingest-drive", sample / "trip_trondheim", "--store", store).code == 0
    assert "twin sync-nvdb" in twin("match", "--store", store).err
    answer = twin("export", tmp_path / "out", "--project", "--store", store)
    assert answer.code == 0
    assert "There are no findings, and no change sets" in answer.err
    answer = twin("evaluate", sample / "truth.csv", "--store", store)
    assert answer.code == 0


def test_match_by_a_method_without_estimates_says_so(twin: Twin, sample: Path, synced: Path) -> None:
    """A method that was never ingested is named with its cure."""
    twin("ingest-drive", sample / "trip_trondheim", "--method", "paper", "--store", synced)
    answer = twin("match", "--method", "single-frame", "--store", synced)
    assert answer.code == 4
    assert "only by paper" in answer.err


def test_verdicts_to_decide_about_are_those_that_are_not_quiet() -> None:
    """`decide --verdict` offers every verdict that asks somebody to decide."""
    assert {verdict.value for verdict in FindingVerdict} == set(Verdict) - QUIET


def test_a_drive_without_sightings_can_still_miss_signs(
    twin: Twin, synced: Path, trip: Path, tmp_path: Path
) -> None:
    """A complete drive whose annotation files name no object: every sign in view is missing, and exports."""
    without_tracks(trip)
    assert twin("ingest-drive", trip, "--store", synced).code == 0
    verdicts = twin("match", "--store", synced, "--json").json["verdicts"]
    assert verdicts["missing"] == 15
    assert sum(verdicts.values()) == 15
    assert twin("export", tmp_path / "out", "--store", synced).code == 0


def test_json_is_one_document_on_stdout(twin: Twin, store: Path) -> None:
    """With --json nothing but JSON is on stdout."""
    for command in (["match"], ["status"]):
        answer = twin(*command, "--store", store, "--json")
        assert isinstance(json.loads(answer.out), dict)


_LATE_SIGNAL = """
import atexit, signal, sys
from twin.cli import main
class Late:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)
atexit.register(lambda: signal.raise_signal(signal.SIGINT))
sys.late = Late()  # goes when the interpreter has given its signal handlers back to the system
main(["--version"])
"""


def test_ctrl_c_after_the_work_does_not_change_the_exit_code() -> None:
    """While Python ends, an interruption comes too late: the success was printed and stays one."""
    done = subprocess.run([sys.executable, "-c", _LATE_SIGNAL], check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("twin ")


def test_ctrl_c_while_modules_are_loaded_says_so() -> None:
    """An interruption at the start leaves with 130 and one sentence, as at any other instant."""
    code = (
        "import builtins, signal\n"
        "from twin import cli\n"
        "real = builtins.__import__\n"
        "def load(name, *rest):\n"
        "    if name == 'twin.cli.app':\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "    return real(name, *rest)\n"
        "builtins.__import__ = load\n"
        "cli.main(['--version'])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stderr.startswith("twin: Interrupted:")
    assert done.stderr.count("\n") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGTERM to catch")
def test_sigterm_ends_with_a_sentence_and_a_line_in_the_log(tmp_path: Path) -> None:
    """What systemd sends ends a command as Ctrl-C does, with a code of its own."""
    code = (
        "import builtins, signal\n"
        "from twin import cli\n"
        "real = builtins.__import__\n"
        "def load(name, *rest):\n"
        "    if name == 'twin.store.store':\n"
        "        signal.raise_signal(signal.SIGTERM)\n"
        "    return real(name, *rest)\n"
        "builtins.__import__ = load\n"
        "cli.main(['--log-file', 'log', 'status'])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=False, capture_output=True, text=True, cwd=tmp_path
    )
    assert (done.returncode, done.stderr.count("\n")) == (143, 1)
    assert done.stderr.startswith("twin: Terminated:")
    last = json.loads((tmp_path / "log").read_text("utf-8").splitlines()[-1])
    assert (last["what"], last["exit_code"]) == ("ended", 143)


def test_exit_code_of_the_unexpected_is_one() -> None:
    """What twin does not know is a bug, not bad data."""
    assert exit_code(ValueError("?")) == 1
