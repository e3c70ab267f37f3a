"""The documents: what they link to is there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml
from checkout import ROOT

PAGES = [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "data" / "README.md"]


def _anchors(page: Path) -> set[str]:
    """The headings of a page as GitHub writes them in addresses."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_every_link_leads_somewhere() -> None:
    """A link to a file, a folder or a heading of this project finds it."""
    dead = []
    for page in PAGES:
        prose = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for link in re.findall(r"\]\((?!https?:)([^)\s]+)\)", prose):
            path, _, heading = link.partition("#")
            target = page.parent / path if path else page
            if not target.exists() or (heading and heading not in _anchors(target)):
                dead.append(f"{page.relative_to(ROOT)}: {link}")
    assert dead == []
    assert len(PAGES) > 25


def test_every_test_that_a_page_names_is_there() -> None:
    """`test_x` in a page is a module under tests/."""
    modules = {path.stem for path in (ROOT / "tests").rglob("test_*.py")}
    named = {
        (page.name, name)
        for page in PAGES
        if page.name != "CHANGELOG.md"
        for name in re.findall(r"`(test_\w+)`", page.read_text(encoding="utf-8"))
    }
    assert sorted((page, name) for page, name in named if name not in modules) == []
    assert len(named) > 10


def test_every_picture_is_shown() -> None:
    """No picture lies in docs/images that no page shows."""
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    assert [
        path.name for path in (ROOT / "docs" / "images").iterdir() if f"images/{path.name}" not in text
    ] == []


class _SiteLoader(yaml.SafeLoader):
    """Reads mkdocs.yml but for the function that it names for anchors."""


_SiteLoader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)


def _leaves(nav: Any) -> list[str]:
    if isinstance(nav, str):
        return [nav]
    return [page for entry in (nav.values() if isinstance(nav, dict) else nav) for page in _leaves(entry)]


def test_every_page_stands_once_in_the_sites_navigation() -> None:
    """mkdocs.yml has each page of docs/ at one place, and names none that is not there."""
    settings = yaml.load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"), _SiteLoader)
    pages = [page.relative_to(ROOT / "docs").as_posix() for page in (ROOT / "docs").rglob("*.md")]
    assert sorted(_leaves(settings["nav"])) == sorted(pages)
    assert settings["theme"]["font"] is False


def test_links_of_the_site_stay_within_it() -> None:
    """A page of docs/ links to nothing beside docs/: the site and the wheel have no more."""
    links = (
        (page, link)
        for page in (ROOT / "docs").rglob("*.md")
        for link in re.findall(r"\]\((?!https?:)([^)#\s]+)", page.read_text(encoding="utf-8"))
    )
    root = ROOT / "docs"
    assert [
        (page.name, link) for page, link in links if not (page.parent / link).resolve().is_relative_to(root)
    ] == []


def test_lists_and_tables_begin_after_a_blank_line() -> None:
    """GitHub reads them without, the builders of the site take them for prose."""
    wrong = []
    for page in (ROOT / "docs").rglob("*.md"):
        text = re.sub(
            r"^```.*?^```$", "```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
        )
        for before, line in zip(text.split("\n"), text.split("\n")[1:], strict=False):
            is_list = re.match(r"(\d+\.|[-*]) ", line) and not re.match(r"\s*(\d+\.|[-*]) |\s|#|$", before)
            is_table = line.startswith("|") and before and not before.startswith(("|", "#"))
            if is_list or is_table:
                wrong.append(f"{page.name}: {line[:60]}")
    assert wrong == []
