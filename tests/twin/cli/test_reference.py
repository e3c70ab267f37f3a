"""docs/reference: nothing is without an explanation, and the pages are what the code says now."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import pytest
import sqlalchemy as sa
from command_line import Twin
from make_reference import FOLDER, PAGES
from typer.main import get_command

from geoloc.locate.error_budget import ErrorBudget
from reference.commands import HELP_OPTION, commands
from reference.field_texts import written_below
from reference.json_shapes import SHAPES, ErrorMessage
from reference.keys import DRIVE_TABLES
from reference.tables import exit_code_meanings
from twin.cli import exit_codes
from twin.cli.app import app
from twin.drives.folder.drive_toml import read_settings
from twin.drives.folder.keys import LABEL_KEYS, ROOT_KEYS
from twin.export.column_meanings import MEANINGS
from twin.export.layers import COLUMNS
from twin.store import schema


@pytest.mark.parametrize("name", PAGES)
def test_page_is_what_the_code_says(name: str) -> None:
    """A page of docs/reference that no longer fits the code is made anew by `make reference`."""
    page = FOLDER / name
    fresh = page.exists() and page.read_text(encoding="utf-8") == PAGES[name]()
    assert fresh, f"docs/reference/{name} is stale: make reference, then commit it"


def test_no_page_is_left_over() -> None:
    """Each page of docs/reference is made."""
    assert {page.name for page in FOLDER.iterdir()} == set(PAGES)


@pytest.mark.parametrize(("name", "command"), commands().items())
def test_every_option_is_explained(name: str, command: Any) -> None:
    """A command says what it does, shows how it is called, and each of its options has a help text."""
    assert command.help
    assert f"Example: twin {name}" in command.epilog
    assert [one.name for one in command.params if one.name != HELP_OPTION and not one.help] == []


def test_every_option_of_all_commands_is_explained() -> None:
    """So are those that stand before the command."""
    assert [one.name for one in get_command(app).params if not one.help] == []


def test_every_key_is_explained() -> None:
    """A key of drive.toml or labels.toml says what it takes and means, a term of the budget what it is."""
    keys = [(name, key) for table in (*DRIVE_TABLES.values(), LABEL_KEYS) for name, key in table.items()]
    assert [name for name, key in keys if not (key.takes and key.meaning)] == []
    assert set(written_below(ErrorBudget)) == {field.name for field in fields(ErrorBudget)}


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
    codes = {
        value
        for name, value in vars(exit_codes).items()
        if name.startswith("EXIT_") and isinstance(value, int)
    }
    assert set(exit_code_meanings()) == codes
    assert all(exit_code_meanings().values())


def test_every_json_document_has_a_type() -> None:
    """A command that takes --json has its document in the reference."""
    typed = {command.partition(" --")[0] for command in SHAPES}
    with_json = {name for name, one in commands().items() if any("--json" in p.opts for p in one.params)}
    assert with_json - typed == set()
    assert {
        " ".join(command.split()[:2])
        if command.startswith(("calibrate", "fleet", "store"))
        else command.split()[0]
        for command in typed
    } == with_json


def _as_text(kind: type, text: str) -> Path:
    assert kind is Path
    return Path(text)


def _reads(command: str, document: Any) -> None:
    """A document has every key that its type names, and at the top no other."""
    msgspec.convert(document, SHAPES[command], str_keys=True, dec_hook=_as_text)


def test_json_documents_are_of_their_types(
    twin: Twin, store: Path, sample: Path, trip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What commands print on the sample is what the reference says that they print."""
    monkeypatch.setenv("TWIN_STORE", str(store))
    out = tmp_path / "out"
    asked = {
        "ingest-drive": ["ingest-drive", trip],
        "match": ["match"],
        "drives": ["drives"],
        "findings": ["findings"],
        "config": ["config"],
        "status": ["status"],
        "confidence": ["confidence"],
        "belief": ["belief"],
        "belief --next": ["belief", "--next"],
        "inspect": ["inspect", trip],
        "trajectory": ["trajectory", trip, "--out", tmp_path / "poses.csv"],
        "locate": ["locate", trip, "C3_tricam120", 84, 1516, 800],
        "evaluate": ["evaluate", sample / "truth.csv"],
        "show": ["show", "P01"],
        "decide --dry-run": ["decide", "accept", "--verdict", "moved", "--dry-run"],
        "decide": ["decide", "accept", "--verdict", "moved"],
        "decide undo": ["decide", "undo"],
        "evidence": ["evidence"],
        "export": ["export", out],
        "qgis": ["qgis", out],
        "simulate": ["simulate", tmp_path / "still", "--scenario", "still"],
    }
    for command, words in asked.items():
        answer = twin(*words, "--json")
        assert answer.code == 0, answer.err
        _reads(command, answer.json)
    finding = next(one for one in twin("match", "--json").json["changes"] if one["verdict"] == "moved")
    _reads("explain", twin("explain", finding["change_id"], "--json").json)
    # Of a method that keeps no residuals, and of a command that fails.
    by_paper = next(one for one in twin("show", "P01", "--json").json["also"] if one.endswith(":paper"))
    shown = twin("show", by_paper, "--json").json
    assert {camera["rms_px"] for camera in shown["cameras"]} == {None}
    _reads("show", shown)
    failed = twin("show", "nothing", "--json")
    told = msgspec.json.decode(failed.err.splitlines()[-1], type=ErrorMessage)
    assert (told.error.code, failed.out) == (failed.code, "")
