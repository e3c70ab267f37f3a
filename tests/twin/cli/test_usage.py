"""What the command line does not understand: one sentence in twin's own words, exit code 2, nothing done."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from command_line import Twin

SENTENCES = {
    "match --method magic": "--method is magic: write one of adjusted, single-frame, paper.",
    "export out --decision open --decision shut": "--decision is shut: write one of accept, open.",
    "decide --verdict new --verdict bad": (
        "--verdict is bad: write one of new, missing, moved, wrong_type, review."
    ),
    "match --tolerance wide": "--tolerance is wide: write a number.",
    "match --tolerance ''": "--tolerance is empty: write a number.",
    "simulate out --speed 900": "--speed is 900: write a number from 1 to 130.",
    "simulate out --seed=-1": "--seed is -1: write a whole number of at least 0.",
    "calibrate example out --pictures 2": "--pictures is 2: write a whole number of at least 5.",
    "decide accept --since 2026-31-01": "--since is 2026-31-01: write a day as 2026-06-01.",
    "match --tolerance": "--tolerance needs a value: write a number.",
    "match --store": "--store needs a value: write a path, or postgresql://USER@HOST/DATABASE.",
    "match --json=1": "--json takes no value: write it alone.",
    "match --tolerence 3": (
        "`twin match` has no option --tolerence (perhaps --tolerance): see `twin match --help`."
    ),
    "calibrate verify trip -x": (
        "`twin calibrate verify` has no option -x: see `twin calibrate verify --help`."
    ),
    "--quiet match --tolerance wide": "--tolerance is wide: write a number.",
    "-q findings --page x": "--page is x: write a whole number of at least 1.",
    "-q calibrate example out --pictures 2": "--pictures is 2: write a whole number of at least 5.",
    "--quiet match --tolerence 3": (
        "`twin match` has no option --tolerence (perhaps --tolerance): see `twin match --help`."
    ),
    "--quiet mach": "There is no command `twin mach` (perhaps match): see `twin --help`.",
    "--quiet --tolerance 3 match": "--tolerance stands after the command: `twin match --tolerance`.",
    "--log-file": "--log-file needs a value: write FILE.",
    "--frobnicate match": "`twin` has no option --frobnicate: see `twin --help`.",
    "--frobnicate": "`twin` has no option --frobnicate: see `twin --help`.",
    "match this too": "`twin match` takes no 'this too': see `twin match --help`.",
    "ingest-drive": "`twin ingest-drive` needs DRIVE: see `twin ingest-drive --help`.",
    "calibrate verify trip": "`twin calibrate verify` needs --known: see `twin calibrate verify --help`.",
    "mach": "There is no command `twin mach` (perhaps match): see `twin --help`.",
    "calibrate wheels": "There is no command `twin calibrate wheels`: see `twin calibrate --help`.",
}


@pytest.mark.parametrize("line", SENTENCES)
def test_usage_error_is_one_sentence_with_the_cure(
    twin: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    """A choice, number, date, option, argument or command that does not fit is named with what would."""
    monkeypatch.chdir(tmp_path)
    answer = twin(*shlex.split(line))
    assert (answer.code, answer.out, answer.err) == (2, "", f"twin: {SENTENCES[line]}\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("before", [[], ["--quiet"], ["--log-file", "log"]])
@pytest.mark.parametrize(
    ("variable", "value", "command", "wanted"),
    [
        ("TWIN_SKRIV_REALM", "GUEST", "submit", "one of EMPLOYEE, SERVICE_ACCOUNT, EXTERNAL"),
        ("TWIN_TOLERANCE", "abc", "match", "a number"),
        ("TWIN_VEGNETT", "maybe", "sync-nvdb", "true or false"),
    ],
)
def test_usage_error_of_an_environment_variable_names_it(
    twin: Twin,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    before: list[str],
    variable: str,
    value: str,
    command: str,
    wanted: str,
) -> None:
    """Nobody looks for an option that was never typed, whatever stands before the command."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(variable, value)
    answer = twin(*before, command, *([tmp_path] if command == "submit" else []))
    assert (answer.code, answer.err) == (2, f"twin: {variable} is {value}: write {wanted}.\n")


def test_json_before_the_command_is_told_where_it_belongs(twin: Twin) -> None:
    """As JSON, since that was asked for."""
    told = twin("--quiet", "--json", "match").error
    assert told["message"] == "--json stands after the command: `twin match --json`."


@pytest.mark.parametrize("group", [[], ["calibrate"], ["--quiet", "calibrate"]])
def test_group_without_a_command_shows_its_help(twin: Twin, group: list[str]) -> None:
    """Nothing asked, nothing wrong: the commands are listed, and the exit code says that none was run."""
    answer = twin(*group)
    assert (answer.code, answer.err) == (2, "")
    assert "Commands" in answer.out
