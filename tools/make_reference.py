"""Write docs/reference/ from the code.

``python tools/make_reference.py`` (`make reference`) writes; a test says when a page is stale.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from reference.commands import commands_page
from reference.keys import drive_toml_page, labels_toml_page
from reference.tables import exit_codes_page, layers_page, store_page

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "reference"
PAGES: Mapping[str, Callable[[], str]] = {
    "commands": commands_page,
    "drive-toml": drive_toml_page,
    "exit-codes": exit_codes_page,
    "labels-toml": labels_toml_page,
    "layers": layers_page,
    "store": store_page,
}


def main() -> None:
    """Write every page."""
    FOLDER.mkdir(exist_ok=True)
    for name, made in PAGES.items():
        (FOLDER / f"{name}.md").write_text(made(), encoding="utf-8", newline="\n")
        print(f"docs/reference/{name}.md")


if __name__ == "__main__":
    main()
