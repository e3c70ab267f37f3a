"""The keys of the files that people write: ``drive.toml`` and ``labels.toml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from geoloc.locate.error_budget import ErrorBudget
from reference.field_texts import written_below
from reference.markdown import code, page, table
from twin.drives.folder import keys as known
from twin.drives.folder.keys import Key

DRIVE_TABLES: Mapping[str, Mapping[str, Key]] = {
    "": known.ROOT_KEYS,
    "cameras.NAME": known.CAMERA_KEYS,
    "gnss": known.GNSS_KEYS,
    "poses": known.POSE_KEYS,
    "poses.topics": known.POSE_TOPIC_KEYS,
    "motion": known.MOTION_KEYS,
    "frames.NAME": known.FRAME_KEYS,
}


def drive_toml_page() -> str:
    """Return docs/reference/drive-toml.md."""
    sections = [
        f"{f'## [{name}]' if name else '## Of the drive'}\n{_table(keys)}"
        for name, keys in DRIVE_TABLES.items()
    ]
    return page(
        "drive.toml, every key",
        "What a drive folder says about itself. No key is needed where the folder shows the same; a misspelt"
        " one is refused with the nearest name. Names of files are relative to the folder."
        " [A drive folder](../drive-folder.md) explains them with examples.",
        *sections,
        _errors(),
    )


def labels_toml_page() -> str:
    """Return docs/reference/labels-toml.md."""
    meanings = [
        ['`"362.50"`', "a sign of this code"],
        ['`["362.50", "808.105"]`', "several plates, top down"],
        ["`{ type = 14 }`", "an object of another NVDB type: located and exported, not compared with NVDB"],
        ['`"ignore"`', "no road object"],
    ]
    return page(
        "labels.toml, every key",
        "What labels mean. [Labels](../labels.md) says which of several files counts.",
        _table(known.LABEL_KEYS),
        "## What a label may mean\n" + table(["under [labels]", "meaning"], meanings),
    )


def _errors() -> str:
    said = written_below(ErrorBudget)
    rows = [
        [code(field.name), f"{field.default:g}", said.get(field.name, "")]
        for field in fields(ErrorBudget)
        if isinstance(field.default, float)
    ]
    return (
        "## [errors]\nOne sigma of each; the end of a name is its unit. [Error budget](../error-budget.md)"
        " says where the defaults are from.\n\n" + table(["term", "default", "meaning"], rows)
    )


def _table(keys: Mapping[str, Key]) -> str:
    rows = [[code(name), key.takes, key.default or "needed", key.meaning] for name, key in keys.items()]
    return table(["key", "takes", "default", "meaning"], rows)
