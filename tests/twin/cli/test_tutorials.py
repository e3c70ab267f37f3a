"""docs/tutorials/: what they show can be pasted."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from checkout import ROOT
from command_line import Twin
from typer.main import get_command

from twin.cli.app import app

PAGES = sorted((ROOT / "docs" / "tutorials").glob("*.md"))


def _lines(page: Path, kind: str) -> Iterator[list[str]]:
    """The commands of a page's code blocks of a kind, word by word."""
    text = page.read_text(encoding="utf-8")
    for found, block in re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE):
        if found == kind:
            yield from (shlex.split(line, comments=True) for line in block.splitlines())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_on_the_sample_run_as_they_stand(
    page: Path, twin: Twin, matched_store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks of kind `sh` go through from top to bottom; the demo's store is the sample without pictures."""
    monkeypatch.chdir(tmp_path)
    ran = 0
    for program, *words in _lines(page, "sh"):
        if program == "export":
            for name, value in (word.split("=", 1) for word in words):
                monkeypatch.setenv(name, value)
        elif words[0] == "demo":
            (tmp_path / "demo-out").mkdir()
            shutil.copy(matched_store, tmp_path / "demo-out" / "demo.db")
        else:
            answer = twin(*words)
            assert answer.code == 0, (words, answer.err)
            ran += 1
    assert ran > 3


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_for_the_readers_own_drive_are_understood(page: Path) -> None:
    """In the other blocks every option is there and every argument has a place."""
    group = get_command(app)
    shown = [words for words in _lines(page, "") if words and words[0] == "twin"]
    for _, name, *words in shown:
        command = group.get_command(None, name)  # type: ignore[attr-defined]
        command.make_context(name, words)
    assert len(shown) >= 3


def test_both_languages_show_the_same_commands() -> None:
    """The Norwegian page is the English one, but for the address and the language of what is printed."""
    english, norwegian = (
        [words for kind in ("sh", "") for words in _lines(ROOT / "docs" / "tutorials" / f"{name}.md", kind)]
        for name in ("municipality", "kommune")
    )
    assert [words[:2] for words in english if words[0] == "twin"] == [
        words[:2] for words in norwegian if words[0] == "twin"
    ]
