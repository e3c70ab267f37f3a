"""docs/reference: nothing is without an explanation, and the pages are what the code says now."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest
import sqlalchemy as sa
from make_reference import FOLDER, PAGES

from geoloc.locate.error_budget import ErrorBudget
from reference.commands import HELP_OPTION, commands
from reference.keys import DRIVE_TABLES, error_terms
from reference.tables import exit_code_meanings
from twin.cli import exit_codes
from twin.drives.folder.drive_toml import read_settings
from twin.drives.folder.keys import LABEL_KEYS, ROOT_KEYS
from twin.export.column_meanings import MEANINGS
from twin.export.layers import COLUMNS
from twin.store import schema


@pytest.mark.parametrize("name", PAGES)
def test_page_is_what_the_code_says(name: str) -> None:
    """A page of docs/reference that no longer fits the code is made anew by `make reference`."""
    page = FOLDER / f"{name}.md"
    fresh = page.exists() and page.read_text(encoding="utf-8") == PAGES[name]()
    assert fresh, f"docs/reference/{name}.md is stale: make reference, then commit it"


def test_no_page_is_left_over() -> None:
    """Each page of docs/reference is made."""
    assert {page.stem for page in FOLDER.glob("*.md")} == set(PAGES)


@pytest.mark.parametrize(("name", "command"), commands().items())
def test_every_option_is_explained(name: str, command: Any) -> None:
    """A command says what it does, shows how it is called, and each of its options has a help text."""
    assert command.help
    assert f"Example: twin {name}" in command.epilog
    assert [one.name for one in command.params if one.name != HELP_OPTION and not one.help] == []


def test_every_key_is_explained() -> None:
    """A key of drive.toml or labels.toml says what it takes and means, a term of the budget what it is."""
    keys = [(name, key) for table in (*DRIVE_TABLES.values(), LABEL_KEYS) for name, key in table.items()]
    assert [name for name, key in keys if not (key.takes and key.meaning)] == []
    assert set(error_terms()) == {field.name for field in fields(ErrorBudget)}


def test_defaults_are_those_of_the_reader() -> None:
    """What the reference calls the default is what an empty drive.toml gives."""
    settings = read_settings(b"")
    flags = {name for name, key in ROOT_KEYS.items() if key.default == "false"}
    assert flags == {"annotations_complete", "detections_complete", "frames_by_number"}
    assert not any(getattr(settings, name) for name in flags)
    assert ROOT_KEYS["datum"].default == settings.datum
    assert float(ROOT_KEYS["pole_radius_m"].default) == settings.pole_radius_m
    assert float(ROOT_KEYS["camera_offset_ms"].default) == settings.camera_offset_ns


def test_every_column_of_a_layer_is_explained() -> None:
    """The layers and their columns are those of the export, each with its meaning."""
    assert {layer: [one.name for one in columns] for layer, columns in COLUMNS.items()} == {
        layer: list(meanings) for layer, meanings in MEANINGS.items()
    }
    assert all(text for meanings in MEANINGS.values() for text in meanings.values())


@pytest.mark.parametrize("table", [*schema.metadata.tables.values(), schema.decision], ids=str)
def test_every_column_of_the_store_is_explained(table: sa.Table) -> None:
    """A table and each of its columns have a comment (``comment=`` of SQLAlchemy)."""
    assert table.comment
    assert [column.name for column in table.columns if not column.comment] == []


def test_every_exit_code_is_explained() -> None:
    """The table at the head of twin.cli.exit_codes has each code once, and no other."""
    codes = {value for name, value in vars(exit_codes).items() if name.startswith("EXIT_")}
    assert set(exit_code_meanings()) == codes
    assert all(exit_code_meanings().values())
