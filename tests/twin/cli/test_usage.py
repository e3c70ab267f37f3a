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
    "match --store": "--store needs a value: write a path.",
    "match --json=1": "--json takes no value: write it alone.",
    "match --tolerence 3": (
        "`twin match` has no option --tolerence (perhaps --tolerance): see `twin match --help`."
    ),
    "calibrate verify trip -x": (
        "`twin calibrate verify` has no option -x: see `twin calibrate verify --help`."
    ),
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


def test_usage_error_of_an_environment_variable_names_it(
    twin: Twin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody looks for an option that was never typed."""
    monkeypatch.setenv("TWIN_SKRIV_REALM", "GUEST")
    answer = twin("submit", tmp_path)
    assert answer.err == (
        "twin: TWIN_SKRIV_REALM is GUEST: write one of EMPLOYEE, SERVICE_ACCOUNT, EXTERNAL.\n"
    )


@pytest.mark.parametrize("group", [[], ["calibrate"]])
def test_group_without_a_command_shows_its_help(twin: Twin, group: list[str]) -> None:
    """Nothing asked, nothing wrong: the commands are listed, and the exit code says that none was run."""
    answer = twin(*group)
    assert (answer.code, answer.err) == (2, "")
    assert "Commands" in answer.out
