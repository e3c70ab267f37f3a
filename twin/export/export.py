"""What ``twin export`` does: decisions made in QGIS come home to the store, then the findings go out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from nvdb.skriv import SKRIV_TEST_URL
from twin.changesets import ChangeSets, files_of, groups_from_store
from twin.decisions.evidence import Evidence
from twin.decisions.log import position
from twin.decisions.record import Edit, keep_edits
from twin.errors import ExportRefusedError, FileError, RefusedError, StoreError
from twin.evidence import n_unmasked_crops
from twin.export.folder import GEOPACKAGES, export_all
from twin.export.from_store import layers_from_store
from twin.export.geopackage import Answer, changes_in, edited_answers, log_position
from twin.export.pictures import drop_pictures, put_pictures
from twin.store.atomic_files import refuse_if_open
from twin.store.kinds import Decision
from twin.store.schema import METHODS
from twin.store.store import Store
from twin.words import Lang


@dataclass(frozen=True, slots=True)
class ExportReport:
    """What an export wrote.

    Attributes
    ----------
    files : tuple of Path
        In the order of :func:`twin.export.export_all`.
    change_sets : ChangeSets
        What became of the decided findings: sets, errors in sets (which are then not written), findings left
        out.
    method : str
        Of the positions: the one that was matched, else the best of the store.
    matched : bool
        Whether there was a match; without one there are positions, and no findings.
    n_unmasked : int
        Pictures that the store has and the export does not get, since nothing was masked in them.
    """

    files: tuple[Path, ...]
    change_sets: ChangeSets
    method: str
    matched: bool = True
    n_unmasked: int = 0


def export_findings(
    store: Store,
    folder: Path | str,
    *,
    by: str = "QGIS",
    decision: str = Decision.ACCEPT,
    project: bool = False,
    api_url: str = SKRIV_TEST_URL,
    lang: Lang = Lang.EN,
    progress: Callable[[str], None] | None = None,
) -> ExportReport:
    """Export the findings of the last match, after keeping what people decided in the last export.

    What was accepted goes out as change sets for API Skriv too (``docs/endringssett.md``). Of a store that
    was never matched the positions go out, by the best method that it has, with no findings beside them.

    Parameters
    ----------
    store : Store
        Never matched, or neither synced nor ingested into since.
    folder : Path
        Made if it does not exist. Decisions edited in QGIS in the GeoPackages already there are kept in the
        store by ``change_id``, also those of changes that the last match no longer found.
    by : str, optional
        Who is to be named for those decisions that name nobody themselves.
    decision : str, optional
        Findings with this decision become change sets; another than ``accept`` gives previews.
    project : bool, optional
        Also put a QGIS project into ``twin_utm33.gpkg`` (:mod:`twin.export.qgis.project`).
    api_url : str, optional
        The API Skriv that the change sets are for: what is under way to it, or carried out there and not yet
        in the mirror, is left out.
    lang : Lang, optional
        Of the reasons, and of what people read in QGIS.
    progress : callable, optional
        Told what is being done.

    Returns
    -------
    ExportReport

    Raises
    ------
    StoreError
        It has no drive yet.
    RefusedError
        The findings are older than the drives or the mirror in the store; or a change set in the folder was
        sent and is not known to have ended.
    ExportRefusedError
        As :func:`twin.export.export_all`; or the decisions in the folder contradict each other, or are none.
    """
    # Not above: that module writes files by this package.
    from twin.changesets.receipts import refuse_if_pending
    from twin.changesets.sent import SentLog

    folder = Path(folder)
    refuse_if_pending(store, folder)
    if store.fact("last_match") is None:
        return _export_positions(store, folder, decision, project=project, lang=lang, progress=progress)
    last = store.matched()
    decided = decisions_made_in(folder)
    if decided:
        if progress is not None:
            progress(f"keeping {len(decided)} decision(s) made in QGIS")
        if store.read_only is not None:
            raise StoreError(
                f"{folder} holds {len(decided)} decision(s) made in QGIS, which the store would have to keep "
                f"first: export to another folder, or mend this. {store.read_only}"
            ) from store.read_only
        edits: dict[str, Edit] = {}
        for path in (folder / name for name in GEOPACKAGES if (folder / name).exists()):
            edits = {**_edits(path, decided), **edits}
        keep_edits(store, edits, by=by)
    noted = position(store.rows)
    pictures = put_pictures(store, folder)
    layers = layers_from_store(store, last["method"], lang, pictures)
    log = SentLog(store, api_url) if decision == Decision.ACCEPT else None
    change_sets = groups_from_store(store, decision, log=log)
    # The layers are of one moment, but of which? The same match before and after it leaves one answer.
    if store.matched() != last:
        raise RefusedError(f"The store {store.name} was matched again during the export: export again.")
    files = export_all(
        layers,
        folder,
        known_answers=decided,
        log_position=noted,
        change_sets=files_of(change_sets),
        project=project,
        lang=lang,
        progress=progress,
    )
    drop_pictures(folder, pictures)
    n_unmasked = n_unmasked_crops(store.rows)
    return ExportReport(tuple(files), change_sets, last["method"], n_unmasked=n_unmasked)


def _export_positions(
    store: Store,
    folder: Path,
    decision: str,
    *,
    project: bool,
    lang: Lang,
    progress: Callable[[str], None] | None,
) -> ExportReport:
    """Export what a store without a match has: estimates, drives, and NVDB's signs if there are any."""
    held = store.methods()
    if not held:
        raise StoreError(f"The store {store.name} has nothing to export yet: run `twin ingest-drive` first.")
    method = min(held, key=METHODS.index)
    layers = layers_from_store(store, method)
    if store.fact("last_match") is not None:
        raise RefusedError(f"The store {store.name} was matched during the export: export again.")
    files = export_all(layers, folder, project=project, lang=lang, progress=progress)
    drop_pictures(folder, {})
    return ExportReport(tuple(files), ChangeSets(decision), method, matched=False)


def decide_as_in(store: Store, path: Path | str, *, by: str, reason: str = "") -> tuple[str, ...]:
    """Bring home the decisions that were made in one exported GeoPackage, wherever it is by now.

    Parameters
    ----------
    store : Store
    path : Path
        A ``twin_utm33.gpkg`` or ``twin_wgs84.gpkg``, under any name. It is not changed.
    by, reason : str
        Who decided and why, where the file does not say it.

    Returns
    -------
    tuple of str
        The changes that were decided anew; what was brought home before is not among them.

    Raises
    ------
    FileError
        There is no such file.
    ExportRefusedError
        It is open in QGIS, not an export, or holds a decision that is none.
    """
    path = Path(path)
    if not path.exists():
        raise FileError(f"There is no file {path}: name a GeoPackage that `twin export` wrote.")
    store.matched()
    refuse_if_open(path)
    answers = edited_answers(path)
    _refuse_unknown(path, answers)
    return keep_edits(store, _edits(path, answers), by=by, reason=reason)


def _edits(path: Path, answers: Mapping[str, Answer]) -> dict[str, Edit]:
    """Edits of one file; what they say is taken from the answers of all files together."""
    found = edited_answers(path)
    if not found:
        return {}
    at = log_position(path)
    rows = {row["change_id"]: row for row in changes_in(path) if row["change_id"] in found}
    edits = {}
    for key in found:
        said = answers[key]
        edits[key] = Edit(said.decision, Evidence.from_row(rows[key]), at, said.comment, said.author)
    return edits


def decisions_made_in(folder: Path) -> dict[str, Answer]:
    """What people decided and wrote in the GeoPackages of a folder since they were exported.

    Parameters
    ----------
    folder : Path
        Need not exist.

    Returns
    -------
    dict
        change_id → what was said, with one of :class:`twin.store.kinds.Decision`.

    Raises
    ------
    ExportRefusedError
        A file is open in QGIS or is not an export; a decision is none of those that exist; or the two files
        disagree about a change.
    """
    decided: dict[str, Answer] = {}
    for name in GEOPACKAGES:
        path = folder / name
        refuse_if_open(path)
        if not path.exists():
            continue
        found = edited_answers(path)
        _refuse_unknown(path, found)
        joined = {change: said.joined(decided.get(change, said)) for change, said in found.items()}
        contrary = [change for change, both in joined.items() if both is None]
        if contrary:
            change = min(contrary)
            raise ExportRefusedError(
                f"{' and '.join(GEOPACKAGES)} in {folder} disagree about {len(contrary)} decision(s) made in "
                f"QGIS (change {change}: {_told(decided[change])} and {_told(found[change])}): "
                "decide the same in both, then export again"
            )
        decided |= {change: both for change, both in joined.items() if both is not None}
    return decided


def _told(answer: Answer) -> str:
    """``accept``; ``accept (no sign there any more, kari)``."""
    words = ", ".join(filter(None, (answer.comment, answer.author)))
    return f"{answer.decision} ({words})" if words else answer.decision


def _refuse_unknown(path: Path, found: Mapping[str, Answer]) -> None:
    """Raise where a decision was typed that the store must not take: no export could write it again."""
    for change in sorted(found):
        said = found[change].decision
        if said not in set(Decision):
            raise ExportRefusedError(
                f'{path} holds the decision "{said}" for change {change}: '
                f"choose one of {', '.join(Decision)} in QGIS, then export again"
            )
