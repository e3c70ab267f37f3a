"""Change sets that an export wrote, read back to be sent: nothing that was changed or never accepted."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvdb.endringssett import Endringssett, from_json, from_xml, to_xml
from twin.changesets.files import PREVIEW, PROVENANCE, is_change_set_file
from twin.errors import ConfigError, RefusedError


@dataclass(frozen=True, slots=True)
class ExportedSet:
    """A change set on the disk.

    Attributes
    ----------
    path : Path
    sett : Endringssett
    sha256 : str
        Of the set as XML: it tells a set, whatever it was written as.
    before : tuple of JSON objects, or None
        The objects before, as received from NVDB; None where the set came from elsewhere.
    """

    path: Path
    sett: Endringssett
    sha256: str
    before: tuple[Mapping[str, Any], ...] | None = None


def exported_sets(path: Path) -> list[ExportedSet]:
    """Read the change sets of an export folder, or one file.

    Raises
    ------
    ConfigError
        There is no such file or folder.
    RefusedError
        It is a preview, holds no set, or a file is not as the export wrote it.
    SchemaError
        A file is no change set.
    """
    if path.is_dir():
        listed = _listed(path)
        if not listed:
            raise RefusedError(
                f"{path} holds no change set: accept findings with `twin decide accept`, then export "
                "to it again."
            )
        return [_read(path / name, sha256) for name, sha256 in listed.items()]
    if not path.exists():
        raise ConfigError(f"There is no {path}: name an export's folder, or one change set in it.")
    if path.name.startswith(PREVIEW):
        raise RefusedError(f"{path} is a preview of findings that nobody has accepted: accept them first.")
    listed = _listed(path.parent)
    sums = next((sums for sums in listed.values() if path.name in sums), None)
    if sums is None and listed and is_change_set_file(path.name):
        raise RefusedError(f"{path} is of an earlier export: send what {PROVENANCE} beside it names.")
    return [_read(path, sums)]


def _listed(folder: Path) -> dict[str, Mapping[str, str]]:
    """Sets that the provenance names: file → SHA-256 of it and of its companions."""
    path = folder / PROVENANCE
    if not path.exists():
        return {}
    try:
        setts = json.loads(path.read_bytes())["sets"]
        return {sett["file"]: dict(sett["sha256"]) for sett in setts if sett["file"] is not None}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RefusedError(f"{path} cannot be read ({error!r}): run `twin export` again.") from error


def _read(path: Path, sums: Mapping[str, str] | None) -> ExportedSet:
    content = _checked(path, sums)
    sett = from_json(content) if path.suffix == ".json" else from_xml(content)
    beside = path.with_name(f"{path.stem}-before.json")
    before: tuple[Mapping[str, Any], ...] | None = None
    if sums is not None and beside.name in sums:
        before = tuple(json.loads(_checked(beside, sums)))
    return ExportedSet(path, sett, hashlib.sha256(to_xml(sett)).hexdigest(), before)


def _checked(path: Path, sums: Mapping[str, str] | None) -> bytes:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RefusedError(f"{path} cannot be read ({error.strerror}): run `twin export` again.") from error
    if sums is not None and sums[path.name] != hashlib.sha256(content).hexdigest():
        raise RefusedError(f"{path} is not as `twin export` wrote it: export again, then send it.")
    return content
