"""Receipts that earlier versions of twin left beside the sets that they sent: read, and never written.

What was sent stands in the store now (:mod:`twin.changesets.sent`).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from nvdb.skriv import UTFORT, UTFORT_OG_ETTERBEHANDLET, WITHOUT_EFFECT
from twin.changesets.sent import SentLog, target_of
from twin.errors import RefusedError
from twin.store.store import Store

RECEIPTS = "kvittering.json"


@dataclass(frozen=True, slots=True)
class Receipt:
    """One set at one API: its id there, how far it was last known to be, and which file it was.

    ``api`` is named as :func:`twin.changesets.sent.target_of` does; ``sha256`` is that of the set as XML.
    """

    api: str
    sha256: str
    set_id: str
    fremdrift: str
    file: str

    @property
    def pending(self) -> bool:
        """Whether it may still be, or become, carried out."""
        return self.fremdrift not in {UTFORT, UTFORT_OG_ETTERBEHANDLET, *WITHOUT_EFFECT}


def receipts_in(folder: Path) -> list[Receipt]:
    """Read the receipts of a folder; none where it has no such file.

    Raises
    ------
    RefusedError
        The file cannot be read: what was sent before is not known.
    """
    path = folder / RECEIPTS
    try:
        every = json.loads(path.read_bytes() if path.exists() else b"{}")
        return [
            Receipt(target_of(api), sha256, **entry)
            for api, entries in every.items()
            for sha256, entry in entries.items()
        ]
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise RefusedError(
            f"{path} cannot be read, and it says what was sent before: mend it, or look in "
            "API Skriv's control panel and move it away."
        ) from error


def refuse_if_pending(store: Store, folder: Path) -> None:
    """Raise RefusedError where a set of a folder was sent and is not known to have ended.

    Its files must not change: they are how its undo set is made.
    """
    apis = SentLog.apis_of(store)
    logs = [SentLog(store, api) for api in apis]
    pending = {
        Path(sent.file): sent.set_id or "that is being registered"
        for log in logs
        for sent in log.unfinished()
        if sent.file and Path(sent.file).parent == folder.resolve()
    }
    known = frozenset(name for log in logs for name in log.tags_and_ids())
    old = [one for one in receipts_in(folder) if one.pending and one.set_id not in known]
    pending |= {folder / one.file: one.set_id for one in old}
    for file, set_id in pending.items():
        raise RefusedError(
            f"The change set {set_id} ({file}) was sent and is not finished: run `twin submit --go` again, "
            "or export to another folder."
        )
