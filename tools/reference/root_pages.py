"""Pages that lie at the root of the repository, for the site and for `twin help`."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def glossary_page() -> str:
    """Return docs/reference/glossary.md."""
    return _copied("GLOSSARY.md")


def conventions_page() -> str:
    """Return docs/reference/conventions.md."""
    return _copied("CONVENTIONS.md")


def _copied(name: str) -> str:
    """A page with its links as they are from docs/reference, and a line that says where it is from."""
    title, _, text = (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](../").partition("\n")
    return f"{title}\nMade from `{name}` by `make reference`: change it there.\n\n{text}"
