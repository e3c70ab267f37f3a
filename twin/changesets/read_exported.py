"""Change sets that an export wrote, read back to be sent: nothing that was changed or never accepted."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nvdb.endringssett import Endringssett, from_json, from_xml, to_xml
from twin.changesets.files import PREVIEW, PROVENANCE, is_change_set_file
from twin.changesets.kontekst import groups_in, object_key, with_findings
from twin.changesets.operations import Group
from twin.errors import FileError, RefusedError


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
    groups : tuple of Group
        Its operations by their findings; empty where it names none.
    listed : tuple of str
        The findings that the provenance beside it names.
    """

    path: Path
    sett: Endringssett
    sha256: str
    before: tuple[Mapping[str, Any], ...] | None = None
    groups: tuple[Group, ...] = ()
    listed: tuple[str, ...] = ()

    @property
    def change_ids(self) -> frozenset[str]:
        """The findings that the set itself names."""
        return frozenset(key for group in self.groups for key in group.change_ids)

    def only(self, groups: Sequence[Group]) -> ExportedSet:
        """Leave out the operations of all other groups."""
        if len(groups) == len(self.groups):
            return self
        kept = {object_key(endring) for group in groups for endring in group.endringer}
        endringer = tuple(e for e in self.sett.endringer if object_key(e) in kept)
        sett = with_findings(replace(self.sett, endringer=endringer), groups)
        return replace(self, sett=sett, groups=tuple(groups), sha256=_sha256_of(sett))


def exported_sets(path: Path, *, may_be_empty: bool = False) -> list[ExportedSet]:
    """Read the change sets of an export folder, or one file.

    Parameters
    ----------
    path : Path
    may_be_empty : bool
        Whether a folder without a set is no error.

    Raises
    ------
    FileError
        There is no such file or folder.
    RefusedError
        It is a preview, holds no set, or a file is not as the export wrote it.
    SchemaError
        A file is no change set.
    """
    if path.is_dir():
        listed = _listed(path)
        if not listed and not may_be_empty:
            raise RefusedError(
                f"{path} holds no change set: accept findings with `twin decide accept`, then export "
                "to it again."
            )
        return [_read(path / name, entry) for name, entry in listed.items()]
    if not path.exists():
        raise FileError(f"There is no {path}: name an export's folder, or one change set in it.")
    if path.name.startswith(PREVIEW):
        raise RefusedError(f"{path} is a preview of findings that nobody has accepted: accept them first.")
    listed = _listed(path.parent)
    entry = next((entry for entry in listed.values() if path.name in entry["sha256"]), None)
    if entry is None and listed and is_change_set_file(path.name):
        raise RefusedError(f"{path} is of an earlier export: send what {PROVENANCE} beside it names.")
    return [_read(path, entry)]


def _listed(folder: Path) -> dict[str, Mapping[str, Any]]:
    """Sets that the provenance names: file → SHA-256 of it and of its companions, and its findings."""
    path = folder / PROVENANCE
    if not path.exists():
        return {}
    try:
        setts = json.loads(path.read_bytes())["sets"]
        return {
            sett["file"]: {"sha256": dict(sett["sha256"]), "changes": tuple(sett["changes"])}
            for sett in setts
            if sett["file"] is not None
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RefusedError(f"{path} cannot be read ({error!r}): run `twin export` again.") from error


def _read(path: Path, entry: Mapping[str, Any] | None) -> ExportedSet:
    sums = None if entry is None else entry["sha256"]
    content = _checked(path, sums)
    sett = from_json(content) if path.suffix == ".json" else from_xml(content)
    beside = path.with_name(f"{path.stem}-before.json")
    before: tuple[Mapping[str, Any], ...] | None = None
    if sums is not None and beside.name in sums:
        before = tuple(json.loads(_checked(beside, sums)))
    listed = () if entry is None else entry["changes"]
    return ExportedSet(path, sett, _sha256_of(sett), before, groups_in(sett), listed)


def _sha256_of(sett: Endringssett) -> str:
    return hashlib.sha256(to_xml(sett)).hexdigest()


def _checked(path: Path, sums: Mapping[str, str] | None) -> bytes:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RefusedError(f"{path} cannot be read ({error.strerror}): run `twin export` again.") from error
    if sums is not None and sums[path.name] != hashlib.sha256(content).hexdigest():
        raise RefusedError(f"{path} is not as `twin export` wrote it: export again, then send it.")
    return content
