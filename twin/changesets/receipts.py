"""What became of the sets of a folder: kept beside them, so that no sign is registered twice."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from nvdb.skriv import IKKE_STARTET, UTFORT, UTFORT_OG_ETTERBEHANDLET
from twin.changesets.files import json_bytes
from twin.errors import RefusedError
from twin.store.atomic_files import replace_file

RECEIPTS = "kvittering.json"
_ENDED_WITHOUT = frozenset({"AVVIST", "KANSELLERT"})


@dataclass(frozen=True, slots=True)
class Receipt:
    """One set at one API: its id there, how far it was last known to be, and which file it was."""

    set_id: str
    fremdrift: str
    file: str

    @property
    def done(self) -> bool:
        """Whether NVDB has taken it."""
        return self.fremdrift in {UTFORT, UTFORT_OG_ETTERBEHANDLET}

    @property
    def pending(self) -> bool:
        """Whether it may still be, or become, carried out."""
        return not self.done and self.fremdrift not in _ENDED_WITHOUT


class Receipts:
    """The receipts of one folder and one API, by the SHA-256 of the set.

    Raises
    ------
    RefusedError
        The file cannot be read: what was sent before is not known.
    """

    def __init__(self, folder: Path, api_url: str) -> None:
        self._path, self._api = folder / RECEIPTS, api_url
        try:
            text = self._path.read_bytes() if self._path.exists() else b"{}"
            every = json.loads(text)
            self._known = {
                api: {sha: Receipt(**entry) for sha, entry in entries.items()}
                for api, entries in every.items()
            }
        except (OSError, ValueError, TypeError, AttributeError) as error:
            raise RefusedError(
                f"{self._path} cannot be read, and it says what was sent before: mend it, or look in "
                "API Skriv's control panel and move it away."
            ) from error

    def get(self, sha256: str) -> Receipt | None:
        """What is known of a set; None if it was never registered."""
        return self._known.get(self._api, {}).get(sha256)

    def every(self) -> list[Receipt]:
        """The receipts of all APIs."""
        return [receipt for entries in self._known.values() for receipt in entries.values()]

    def put(self, sha256: str, set_id: str, fremdrift: str, file: str) -> None:
        """Keep how far a set is, at once on the disk."""
        self._known.setdefault(self._api, {})[sha256] = Receipt(set_id, fremdrift, file)
        document = {
            api: {sha: asdict(entry) for sha, entry in entries.items()}
            for api, entries in self._known.items()
        }
        replace_file(self._path, json_bytes(document))


def refuse_if_pending(folder: Path) -> None:
    """Raise RefusedError where a set of a folder was sent and is not known to have ended.

    Its files must not change: they are how it is taken up again, and how its undo set is made.
    """
    for receipt in Receipts(folder, "").every():
        if receipt.pending:
            raise RefusedError(
                f"The change set {receipt.set_id} ({folder / receipt.file}) was sent and is not finished: "
                "run `twin submit --go` again, or export to another folder."
            )


NEW = IKKE_STARTET
"""Of a set that was registered just now."""
