"""`twin help`: the pages, wherever twin is installed."""

from __future__ import annotations

import re

import pytest
from checkout import ROOT
from command_line import Twin
from hatchling.builders.wheel import WheelBuilder
from rich.console import Console

from twin.cli import help as help_module
from twin.cli.help import help_pages

PACKAGES = ("twin", "nvdb", "geoloc")


def test_list_has_every_page_with_its_title(twin: Twin) -> None:
    """`twin help` names each page, and no two pages by one name."""
    answer = twin("help")
    assert answer.code == 0
    pages = help_pages()
    left_out = {"decisions", "index"}
    files = [path for path in (ROOT / "docs").rglob("*.md") if not {path.parent.name, path.stem} & left_out]
    assert sorted(pages.values()) == sorted(files)
    for topic, page in pages.items():
        title = page.read_text(encoding="utf-8").splitlines()[0]
        assert re.search(rf"│ {topic} +│ {re.escape(title.removeprefix('# '))} +│", answer.out), topic


def test_page_on_a_pipe_is_plain_markdown(twin: Twin) -> None:
    """What a pipe gets is the file."""
    answer = twin("help", "labels")
    assert (answer.code, answer.out) == (0, (ROOT / "docs" / "labels.md").read_text(encoding="utf-8"))


def test_page_on_a_terminal_is_laid_out(twin: Twin, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal no Markdown is left, and a link to a page is the command that shows it."""
    monkeypatch.setattr(
        help_module,
        "console",
        lambda: Console(force_terminal=True, no_color=True, width=500, legacy_windows=False),
    )
    shown = re.sub(r"\x1b\[[\d;]*m", "", twin("help", "review").out)
    assert "[log](decisions-and-review.md#the-log)" in (ROOT / "docs" / "review.md").read_text(
        encoding="utf-8"
    )
    assert "log (twin help decisions-and-review)" in shown
    assert "](" not in shown


def test_command_shows_its_options(twin: Twin) -> None:
    """`twin help COMMAND` is its --help; where a page has its name, the page says how to get there."""
    assert twin("help", "calibrate", "verify").out == twin("calibrate", "verify", "--help").out
    both = twin("help", "review")
    assert both.out.startswith("# ")
    assert "twin review --help" in both.err


def test_unknown_topic_names_the_nearest(twin: Twin) -> None:
    """A slip is a usage error that names what was perhaps meant."""
    answer = twin("help", "lables")
    assert answer.code == 2
    assert answer.err.startswith("twin: There is no topic 'lables' (perhaps labels")
    assert answer.err.endswith("): `twin help` lists them.\n")


def test_messages_name_topics_that_are_there() -> None:
    """A message points to `twin help TOPIC`, for the wheel has no docs folder, and the topic exists."""
    code = "".join(
        path.read_text(encoding="utf-8")
        for package in PACKAGES
        for kind in ("*.py", "*.toml", "*.js", "*.html")
        for path in (ROOT / package).rglob(kind)
    )
    topics = set(re.findall(r"twin help ([a-z][\w-]*)", code))
    assert {"labels", "drive-folder"} <= topics
    assert topics - set(help_pages()) == set()
    assert re.findall(r'^[^#\n]*(?<!")"(?!")[^"\n]*docs/[\w-]+\.md.*', code, flags=re.MULTILINE) == []


def test_wheel_carries_the_pages() -> None:
    """The wheel's settings put each page where `twin help` looks first."""
    builder = WheelBuilder(str(ROOT))
    packed = {file.distribution_path for file in builder.recurse_included_files()}
    docs = ROOT / "docs"
    assert {f"twin/pages/{page.relative_to(docs).as_posix()}" for page in help_pages().values()} <= packed
    assert not [path for path in packed if path.endswith(".png") and path.startswith("twin/pages/")]


@pytest.mark.parametrize(
    ("word", "page"), [("excel", "daily"), ("toml", "drive-toml"), ("undo", "decisions-and-review")]
)
def test_a_word_is_looked_for_in_the_pages(twin: Twin, word: str, page: str) -> None:
    """What no page is called by is found where pages tell of it."""
    answer = twin("help", word)
    assert (answer.code, page in answer.err) == (2, True), answer.err


def test_a_topic_may_be_written_as_its_file(twin: Twin) -> None:
    """Capitals and the ending do not matter; and flags take no value in the help."""
    assert twin("help", "QGIS.md").out == twin("help", "qgis").out != ""
    for line in (["--help"], ["decide", "--help"], ["calibrate", "--help"]):
        assert "bool" not in twin(*line).out
