"""Send change sets to API Skriv: checks first, then register, start, wait, report, and keep the way back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nvdb.datakatalog import Datakatalog, snapshot
from nvdb.endringssett import ADVARSEL, errors, validate
from nvdb.skriv import FINAL, IKKE_STARTET, EndringssettStatus, SkrivClient
from twin.changesets.read_exported import ExportedSet
from twin.changesets.receipts import NEW, Receipts
from twin.changesets.undo import write_undo
from twin.errors import RefusedError

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Submitted:
    """What became of one set.

    Attributes
    ----------
    file : str
    accepted : bool
        Carried out; without sending: that nothing speaks against it as far as was asked.
    sentences : tuple of str
        What was found or answered.
    objects : tuple of mapping
        ``operation, nvdb_id, version, result`` of each object, in the order of the set.
    set_id : str or None
        At API Skriv.
    undo : str or None
        File of the set that undoes it.
    """

    file: str
    accepted: bool
    sentences: tuple[str, ...]
    objects: tuple[Mapping[str, Any], ...] = ()
    set_id: str | None = None
    undo: str | None = None


def checked(found: ExportedSet, client: SkrivClient | None = None) -> Submitted:
    """Check a set without sending it: by our own rules, and with a client by API Skriv's validator."""
    findings = validate(found.sett, _katalog(found))
    if found.before is not None:
        # The export has looked these up in the store's own datakatalog.
        findings = tuple(f for f in findings if (f.code, f.severity) != ("UGYLDIG_FLERVERDI", ADVARSEL))
    said = tuple(str(finding) for finding in findings)
    if errors(findings) or client is None:
        return Submitted(found.path.name, not errors(findings), said, _objects(found, None))
    status = client.validate(found.sett)
    return Submitted(found.path.name, status.accepted, (*said, *status.sentences()), _objects(found, status))


def not_done(found: Sequence[ExportedSet], receipts: Mapping[Path, Receipts]) -> list[ExportedSet]:
    """Return the sets that NVDB has not taken yet.

    Raises
    ------
    RefusedError
        It has taken all of them.
    """
    known = {item.path: receipts[item.path.parent].get(item.sha256) for item in found}
    left = [item for item in found if (receipt := known[item.path]) is None or not receipt.done]
    if not left:
        ids = ", ".join(receipt.set_id for receipt in known.values() if receipt is not None)
        raise RefusedError(
            f"{found[0].path} was carried out before ({ids}): sync, match and export anew."
            if len(found) == 1
            else f"All {len(found)} change sets were carried out before ({ids}): sync, match and export anew."
        )
    return left


def sent(
    found: ExportedSet, client: SkrivClient, receipts: Receipts, *, timeout_s: float, say: Say
) -> Submitted:
    """Send a set and wait for what becomes of it.

    A set that was registered before and is not final is taken up where it stands, never registered twice.

    Parameters
    ----------
    found : ExportedSet
        One of :func:`not_done`.
    client : SkrivClient
    receipts : Receipts
        Of its folder.
    timeout_s : float
        Longest wait.
    say : callable
        Told what is being done.

    Raises
    ------
    TransportError
        API Skriv did not answer as it should; where the set was registered, the receipts say so.
    """
    before = receipts.get(found.sha256)
    if before is not None and before.pending:
        set_id = before.set_id
        say(f"{found.path.name} was registered before as {set_id}: asking how far it is")
    else:
        trial = checked(found, client)
        if not trial.accepted:
            return trial
        set_id = client.send(found.sett)
        receipts.put(found.sha256, set_id, NEW, found.path.name)
        say(f"{found.path.name} is registered as {set_id}")
    status = _carried_out(client, set_id, timeout_s, say)
    undo, why = write_undo(found, status) if status.accepted else (None, ())
    # Last: a set that is not said to be done is taken up again, and its undo set written then.
    receipts.put(found.sha256, set_id, status.fremdrift, found.path.name)
    return Submitted(
        file=found.path.name,
        accepted=status.accepted,
        sentences=(*status.sentences(), *why),
        objects=_objects(found, status),
        set_id=set_id,
        undo=undo,
    )


def _carried_out(client: SkrivClient, set_id: str, timeout_s: float, say: Say) -> EndringssettStatus:
    code = client.progress(set_id)
    if code == IKKE_STARTET:
        client.start(set_id)
        say(f"{set_id} is started")
    if code not in FINAL:
        say(f"{set_id}: {client.poll(set_id, timeout_s=timeout_s)}")
    return client.status(set_id)


def _katalog(found: ExportedSet) -> Datakatalog:
    """The shipped datakatalog, taken as of the set's version: partial lists refuse no new value.

    The export has checked the set against the store's own.
    """
    return replace(snapshot(), version=found.sett.datakatalogversjon)


def _objects(found: ExportedSet, status: EndringssettStatus | None) -> tuple[Mapping[str, Any], ...]:
    answers = status.objekter if status is not None else ()
    by_name = {answer.temp_id: answer for answer in answers if answer.temp_id is not None}
    by_id = {answer.nvdb_id: answer for answer in answers if answer.nvdb_id is not None}
    rows = []
    for endring in found.sett.endringer:
        answer = by_id.get(endring.nvdb_id) if endring.nvdb_id else by_name.get(endring.temp_id or "")
        said = answer.varsler if answer is not None else None
        told = [*said.feil, *said.advarsler, *said.notabener] if said is not None else []
        rows.append(
            {
                "operation": f"{endring.operasjon} {endring.type_id}",
                "nvdb_id": answer.nvdb_id if answer is not None else endring.nvdb_id,
                "version": answer.versjon if answer is not None else endring.versjon,
                "result": "; ".join(f"{item.melding} ({item.kode})" for item in told)
                or ("no remark" if status is not None else "not asked"),
            }
        )
    return tuple(rows)
