"""Send change sets to API Skriv: checks first, then register, start, wait, report, and keep the way back.

Nothing is sent twice (:mod:`twin.changesets.sent`): one process at a time, the store is written before each
request, API Skriv is asked what it has of ours, and a set goes only as the store would export it now.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nvdb.datakatalog import Datakatalog, snapshot
from nvdb.endringssett import ADVARSEL, errors, validate
from nvdb.errors import HttpStatusError, NvdbError
from nvdb.skriv import FINAL, IKKE_STARTET, EndringssettStatus, SkrivClient
from twin.changesets.at_api import OF_RECEIPT, Elsewhere, adopt_receipts, look_up, rival_of
from twin.changesets.build import groups_from_store
from twin.changesets.kontekst import digest_of
from twin.changesets.left_out import left_out_sentence
from twin.changesets.operations import Group
from twin.changesets.read_exported import ExportedSet, exported_sets
from twin.changesets.sent import Basis, SentLog, SentSet
from twin.changesets.undo import write_undo
from twin.errors import RefusedError, TwinError
from twin.store.kinds import Sending
from twin.store.store import Store

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


def submit(
    path: Path, store: Store, client: SkrivClient, *, api_url: str, timeout_s: float, say: Say
) -> Iterator[Submitted]:
    """Send the change sets of a folder, or one, and yield what became of each.

    What was sent before and is not known to have ended is taken up first, wherever it was sent from.

    Parameters
    ----------
    path : Path
        An export's folder, or one change set.
    store : Store
        That exported it.
    client : SkrivClient
    api_url : str
        Its address.
    timeout_s : float
        Longest wait for one set.
    say : callable
        Told what is being done.

    Raises
    ------
    RefusedError
        Another process submits from this store, nothing is left to send, a set does not say which findings it
        is of, or the store was changed by a sync or an ingest since it was matched.
    TransportError
        API Skriv did not answer as it should; the store knows how far each set is.
    """
    with store.alone("submit", "submit"):
        log = SentLog(store, api_url)
        yield from _Submission(store, log, client, timeout_s, say).results(path)


@dataclass(frozen=True, slots=True)
class _Submission:
    """One run of ``twin submit --go``, while it holds the lock."""

    store: Store
    log: SentLog
    client: SkrivClient
    timeout_s: float
    say: Say

    def results(self, path: Path) -> Iterator[Submitted]:
        """Finish what is under way, then send what is left."""
        exported = exported_sets(path, may_be_empty=True)
        adopt_receipts(self.store, self.log, self.client, path, exported)
        elsewhere = look_up(self.store, self.log, self.client)
        n = 0
        for sent in self.log.unfinished():
            done = self._taken_up(sent, exported, elsewhere)
            if done is not None:
                n += 1
                yield done
        if not exported and not n:
            exported_sets(path)
        basis = self.log.basis()
        left, told = self._left(exported, elsewhere)
        if not left and exported and not n:
            raise RefusedError(
                f"{path}: {told}, so nothing is left to send: sync, match, and export what is accepted then."
            )
        if told and not left:
            self.say(f"{path}: {told}")
        for number, found in enumerate(left):
            done = self._sent(found, basis)
            more = (f"{path}: {told}.",) if told and number == 0 else ()
            yield replace(done, sentences=(*done.sentences, *more))

    def _taken_up(
        self, sent: SentSet, exported: Sequence[ExportedSet], elsewhere: Mapping[str, Elsewhere]
    ) -> Submitted | None:
        """Go on with a set that API Skriv has; None where it is left alone, or cancelled."""
        set_id = sent.set_id or ""
        name = Path(sent.file).name
        found = next((one for item in exported if (one := _same(item, sent)) is not None), None)
        code = self.client.progress(set_id)
        if found is None and code != IKKE_STARTET and code not in FINAL:
            return None
        self.say(f"{name} was registered before as {set_id}: asking how far it is")
        if code == IKKE_STARTET and not self._may_start(sent, found, elsewhere):
            return None
        return self._carried_out(sent, found or _at_its_place(sent))

    def _may_start(
        self, sent: SentSet, found: ExportedSet | None, elsewhere: Mapping[str, Elsewhere]
    ) -> bool:
        """Whether a set that was registered may still be started; if it never may, it is cancelled."""
        if found is not None and not found.groups:
            return True
        if not any(sent.digests.values()):
            return False
        try:
            now = self._accepted(again=sent.digests)
        except TwinError:
            # Not matched since a sync or an ingest: it waits.
            return False
        is_as_accepted = all(now.get(key) == digest for key, digest in sent.digests.items())
        if is_as_accepted and self.log.is_free_but_for(sent) and elsewhere.keys().isdisjoint(sent.digests):
            return True
        self.client.cancel(sent.set_id or "")
        self.log.ended(sent, Sending.WITHOUT_EFFECT)
        self.say(f"{sent.set_id} was never started and is cancelled: the store would not send it so now")
        return False

    def _left(
        self, exported: Sequence[ExportedSet], elsewhere: Mapping[str, Elsewhere]
    ) -> tuple[list[ExportedSet], str]:
        """Keep of the sets what is to be sent now, and say what is left out."""
        held = self.log.held()
        for found in exported:
            if found.sha256 not in held:
                _refuse_unnamed(found)
        taken = held.keys() | elsewhere.keys()
        unsent = [
            (found, [group for group in found.groups if taken.isdisjoint(group.change_ids)])
            for found in exported
        ]
        now = self._accepted() if any(groups for _, groups in unsent) else {}
        left, outdated = [], []
        for found, groups in unsent:
            kept = [group for group in groups if _is_as_in(group, now)]
            outdated += [key for group in groups if group not in kept for key in group.change_ids]
            if kept or (not found.groups and found.sha256 not in held):
                left.append(found.only(kept))
        wanted = {key for found in exported for key in found.change_ids or {found.sha256}}
        return left, left_out_sentence(
            [held[key] for key in sorted(wanted & held.keys())],
            [elsewhere[key].set_id for key in sorted(wanted & elsewhere.keys())],
            len(outdated),
        )

    def _accepted(self, again: Mapping[str, str] | None = None) -> dict[str, str]:
        """Finding → SHA-256 of what the store would have done about it now."""
        made = groups_from_store(self.store, log=self.log, again=again or ())
        return {
            key: digest_of(group)
            for sett in made.setts
            if not sett.errors
            for group in sett.groups
            for key in group.change_ids
        }

    def _sent(self, found: ExportedSet, basis: Basis) -> Submitted:
        """Check a set, register it, start it, and wait for what becomes of it."""
        trial = checked(found, self.client)
        if not trial.accepted:
            return trial
        tag = f"twin-{uuid.uuid4()}"
        removing = tuple(e for e in found.sett.endringer if e.operasjon == "fjern")
        groups = found.groups or (Group((found.sha256,), removing),)
        self.log.begin(tag, groups, found.path, basis if found.groups else None)
        try:
            set_id = self.client.send(replace(found.sett, ekstern_ref=tag))
        except HttpStatusError as error:
            if error.status < 500 and not error.retryable:
                self.log.ended(self._open(tag), Sending.WITHOUT_EFFECT)
            raise
        self.log.registered(tag, set_id)
        self.say(f"{found.path.name} is registered as {set_id}")
        return self._carried_out(self._open(tag), found)

    def _open(self, tag: str) -> SentSet:
        return next(sent for sent in self.log.unfinished() if sent.tag == tag)

    def _carried_out(self, sent: SentSet, found: ExportedSet | None) -> Submitted:
        """Start a registered set if it is not, wait, and keep what became of it."""
        set_id, name = sent.set_id or "", Path(sent.file).name
        code = self.client.progress(set_id)
        if code == IKKE_STARTET:
            rival = rival_of(self.store, self.log, self.client, set_id, sent.digests)
            if rival is not None:
                self.client.cancel(set_id)
                self.log.ended(sent, Sending.WITHOUT_EFFECT)
                why = f"another copy of this store has {rival.set_id} on the way with its findings"
                return Submitted(name, False, (f"{set_id} is cancelled: {why}.",), set_id=set_id)
            self.client.start(set_id)
            self.say(f"{set_id} is started")
        if code not in FINAL:
            self.say(f"{set_id}: {self.client.poll(set_id, timeout_s=self.timeout_s)}")
        status = self.client.status(set_id)
        undo, why_not = _undo_of(found, status)
        # Last: a set that is not said to have ended is taken up again, and its undo set written then.
        state = Sending.CARRIED_OUT if status.accepted else Sending.WITHOUT_EFFECT
        self.log.ended(sent, state, status.nvdb_ids)
        return Submitted(
            file=name if found is None else found.path.name,
            accepted=status.accepted,
            sentences=(*status.sentences(), *why_not),
            objects=() if found is None else _objects(found, status),
            set_id=set_id,
            undo=undo,
        )


def _undo_of(found: ExportedSet | None, status: EndringssettStatus) -> tuple[str | None, tuple[str, ...]]:
    """Write the set that undoes one that was carried out; else say why there is none."""
    if not status.accepted:
        return None, ()
    if found is None:
        return None, ("There is no set to undo it: the files that it was sent from are gone.",)
    return write_undo(found, status)


def _refuse_unnamed(found: ExportedSet) -> None:
    """Raise where nobody could tell whether a set was sent before.

    NVDB itself takes no second change of the same version; a registration it takes as often as it comes.
    """
    registers = any(endring.operasjon == "registrer" for endring in found.sett.endringer)
    if not found.groups and (registers or found.listed or found.sett.kontekst is not None):
        raise RefusedError(
            f"{found.path} does not say which findings it is of (earlier versions of twin did not), so "
            "nobody can tell whether they were sent before: `twin export` it again."
        )


def _is_as_in(group: Group, accepted: Mapping[str, str]) -> bool:
    digest = digest_of(group)
    return all(accepted.get(key) == digest for key in group.change_ids)


def _same(found: ExportedSet, sent: SentSet) -> ExportedSet | None:
    """Of an exported set the part that was sent; None where it does not hold all of it."""
    if found.sha256 in sent.digests or sent.tag == f"{OF_RECEIPT}{found.sha256}":
        return found
    groups = [group for group in found.groups if all(key in sent.digests for key in group.change_ids)]
    part = {key: digest_of(group) for group in groups for key in group.change_ids}
    return found.only(groups) if part and part == sent.digests else None


def _at_its_place(sent: SentSet) -> ExportedSet | None:
    """Read what was sent from where it was; None where it is gone, or another by now."""
    with suppress(TwinError, NvdbError):
        return next((one for item in exported_sets(Path(sent.file)) if (one := _same(item, sent))), None)
    return None


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
