"""Write docs/reference/ from the code.

``python tools/make_reference.py`` (`make reference`) writes; a test says when a page is stale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from reference.commands import commands_page
from reference.json_page import SCHEMAS, json_page, schema_document
from reference.keys import drive_toml_page, labels_toml_page
from reference.root_pages import conventions_page, glossary_page
from reference.tables import exit_codes_page, layers_page, store_page

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "reference"
PAGES: Mapping[str, Callable[[], str]] = {
    "commands.md": commands_page,
    "conventions.md": conventions_page,
    "drive-toml.md": drive_toml_page,
    "exit-codes.md": exit_codes_page,
    "glossary.md": glossary_page,
    "json.md": json_page,
    SCHEMAS: schema_document,
    "labels-toml.md": labels_toml_page,
    "layers.md": layers_page,
    "store.md": store_page,
}


def main() -> None:
    """Write every page."""
    FOLDER.mkdir(exist_ok=True)
    for name, made in PAGES.items():
        (FOLDER / name).write_text(made(), encoding="utf-8", newline="\n")
        print(f"docs/reference/{name}")


if __name__ == "__main__":
    main()
