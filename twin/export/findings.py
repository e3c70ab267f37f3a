"""What ``twin export`` does: decisions made in QGIS come home to the store, then the findings go out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from twin.errors import ExportRefusedError, RefusedError, StoreError
from twin.export.atomic import refuse_if_open
from twin.export.folder import GEOPACKAGES, export_all
from twin.export.from_store import layers_from_store
from twin.export.geopackage import edited_decisions
from twin.export.verdicts import DECISIONS
from twin.store import Store


def export_findings(
    store: Store, folder: Path | str, *, progress: Callable[[str], None] | None = None
) -> list[Path]:
    """Export the findings of the last match, after keeping what people decided in the last export.

    Parameters
    ----------
    store : Store
        Matched, and neither synced nor ingested into since.
    folder : Path
        Made if it does not exist. Decisions edited in QGIS in the GeoPackages already there are kept in the
        store by ``change_id``, also those of changes that the last match no longer found.
    progress : callable, optional
        Told what is being done.

    Returns
    -------
    list of Path
        The files of :func:`twin.export.export_all`.

    Raises
    ------
    StoreError
        Nothing was matched yet.
    RefusedError
        The findings are older than the drives or the mirror in the store.
    ExportRefusedError
        As :func:`twin.export.export_all`; or the decisions in the folder contradict each other, or are none.
    """
    folder = Path(folder)
    last = _last_match(store)
    decided = decisions_made_in(folder)
    if decided:
        if progress is not None:
            progress(f"keeping {len(decided)} decision(s) made in QGIS")
        store.save_decisions(decided)
    layers = layers_from_store(store, last["method"])
    # The layers are of one moment, but of which? The same match before and after it leaves one answer.
    if _last_match(store) != last:
        raise RefusedError(f"The store {store.path} was matched again during the export: export again.")
    return export_all(layers, folder, known_decisions=decided, progress=progress)


def decisions_made_in(folder: Path) -> dict[str, str]:
    """Decisions that people made in the GeoPackages of a folder since they were exported.

    Parameters
    ----------
    folder : Path
        Need not exist.

    Returns
    -------
    dict
        change_id → one of :data:`twin.export.DECISIONS`.

    Raises
    ------
    ExportRefusedError
        A file is open in QGIS or is not an export; a decision is none of those that exist; or the two files
        disagree about a change.
    """
    decided: dict[str, str] = {}
    for name in GEOPACKAGES:
        path = folder / name
        refuse_if_open(path)
        if not path.exists():
            continue
        found = edited_decisions(path)
        _refuse_unknown(path, found)
        contrary = {change for change, said in found.items() if decided.get(change, said) != said}
        if contrary:
            change = min(contrary)
            raise ExportRefusedError(
                f"{' and '.join(GEOPACKAGES)} in {folder} disagree about {len(contrary)} decision(s) made in "
                f"QGIS (change {change}: {decided[change]} and {found[change]}): "
                "decide the same in both, then export again"
            )
        decided |= found
    return decided


def _last_match(store: Store) -> dict[str, Any]:
    """Facts of the last match, provided that its findings are those of the store's drives and mirror."""
    last = store.fact("last_match")
    if last is None:
        raise StoreError(f"The store {store.path} has no findings yet: run `twin match` first.")
    if last["revision"] != store.revision():
        raise RefusedError(
            f"The store {store.path} has changed since the last match (sync or ingest): "
            "run `twin match` again, then export."
        )
    return last


def _refuse_unknown(path: Path, found: dict[str, str]) -> None:
    """Raise where a decision was typed that the store must not take: no export could write it again."""
    for change, said in sorted(found.items()):
        if said not in DECISIONS:
            raise ExportRefusedError(
                f'{path} holds the decision "{said}" for change {change}: '
                f"choose one of {', '.join(DECISIONS)} in QGIS, then export again"
            )
