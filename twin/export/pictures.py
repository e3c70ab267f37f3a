"""Pictures of findings beside an export: masked crops alone, each under the SHA-256 of its content."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from twin.errors import ExportRefusedError
from twin.evidence import Crop, crop_file, exportable_crops
from twin.evidence.crops import Role
from twin.store.atomic_files import replace_file
from twin.store.folders import make_folder
from twin.store.store import Store

CROPS = "crops"
"""The folder of the pictures in an export's own."""
_OURS = re.compile(r"[0-9a-f]{64}\.webp")


@dataclass(frozen=True, slots=True)
class Pictures:
    """Where the pictures of a finding's best view lie: paths in the export's folder, or ""."""

    face: str = ""
    wide: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the files."""
        return tuple(Path(path).name for path in (self.face, self.wide) if path)


NO_PICTURES = Pictures()


def put_pictures(store: Store, folder: Path) -> dict[str, Pictures]:
    """Copy the pictures of every finding's best view into an export's folder.

    Crops that were not masked are left out, whoever asked for them. A file that is damaged or was deleted
    meanwhile is left out too. Pictures of before stay until :func:`drop_pictures`.

    Returns
    -------
    dict
        change_id → its pictures, of findings that have any.

    Raises
    ------
    ExportRefusedError
        The folder cannot be written.
    """
    best: dict[str, dict[Role, str]] = {}
    for crop in exportable_crops(store.rows):
        roles = best.setdefault(crop.change_id, {})
        if crop.role not in roles and _is_put(store, crop, folder / CROPS):
            roles[crop.role] = f"{CROPS}/{crop.sha256}.webp"
    return {
        change: Pictures(roles.get(Role.FACE, ""), roles.get(Role.WIDE, ""))
        for change, roles in best.items()
        if roles
    }


def drop_pictures(folder: Path, kept: Mapping[str, Pictures]) -> None:
    """Delete the pictures of earlier exports that this one does not name; other files stay."""
    names: Collection[str] = {name for pictures in kept.values() for name in pictures.names}
    if not (folder / CROPS).is_dir():
        return
    for path in (folder / CROPS).iterdir():
        if _OURS.fullmatch(path.name) and path.name not in names:
            path.unlink(missing_ok=True)
    with suppress(OSError):  # it still holds something
        (folder / CROPS).rmdir()


def _is_put(store: Store, crop: Crop, folder: Path) -> bool:
    """Copy one crop, unless it lies there; tell whether it does now."""
    target = folder / f"{crop.sha256}.webp"
    try:
        content = crop_file(store, crop.sha256).read_bytes()
    except OSError:
        return False
    if hashlib.sha256(content).hexdigest() != crop.sha256:
        return False
    try:
        if not target.is_file() or target.read_bytes() != content:
            make_folder(folder)
            replace_file(target, content)
    except OSError as error:
        raise ExportRefusedError(
            f"cannot export to {folder}: {error.strerror}: "
            "free space on the disk or give a folder that can be written"
        ) from error
    return True
