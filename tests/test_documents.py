"""The documents: what they link to is there."""

from __future__ import annotations

import re
from pathlib import Path

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
