"""Markdown of the reference pages."""

from __future__ import annotations

from collections.abc import Sequence

MADE = "Made from the code by `make reference`: change it there."


def page(title: str, *parts: str) -> str:
    """Return a page: its title, how it was made, its parts with a blank line between them."""
    return "\n\n".join([f"# {title}\n{MADE}", *(part.strip("\n") for part in parts if part)]) + "\n"


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; a bar in a cell is told apart from its own."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(text.replace("|", "\\|") for text in line) + " |" for line in lines)


def code(text: str) -> str:
    """Return a text as code; nothing stays nothing."""
    return f"`{text}`" if text else ""
