"""What API Skriv says about a change set: how far it is, what it found, which ids the new objects got.

Source: API Skriv V3, *Behandlingsresultat* and *API-referanse* (Status, Fremdrift, Ressurser, fault).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from nvdb.endringssett.xml import local_name, parse_xml
from nvdb.errors import SchemaError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

IKKE_STARTET: Final = "IKKE_STARTET"
BEHANDLES: Final = "BEHANDLES"
VENTER: Final = "VENTER"
AVVIST: Final = "AVVIST"
UTFORT: Final = "UTFØRT"
UTFORT_OG_ETTERBEHANDLET: Final = "UTFØRT_OG_ETTERBEHANDLET"
KANSELLERT: Final = "KANSELLERT"
WITHOUT_EFFECT: Final = frozenset({AVVIST, KANSELLERT})
"""Codes after which NVDB is as it was before the set."""

FINAL: Final = frozenset({AVVIST, UTFORT, UTFORT_OG_ETTERBEHANDLET, KANSELLERT})
"""Codes after which nothing more happens (after ``UTFØRT``, only API Les still has to catch up)."""

_ID: Final = re.compile(r"/endringssett/([0-9A-Za-z-]{1,64})(?:/|$)")


@dataclass(frozen=True, slots=True)
class Varsel:
    """One thing that API Skriv says.

    `kode` may change its spelling without notice, so nothing should depend on it.
    """

    kode: str
    melding: str
    referanse: str | None = None
    egenskap_type_id: int | None = None


@dataclass(frozen=True, slots=True)
class Varsler:
    """Errors, for which a set is refused; warnings; notes."""

    feil: tuple[Varsel, ...] = ()
    advarsler: tuple[Varsel, ...] = ()
    notabener: tuple[Varsel, ...] = ()


@dataclass(frozen=True, slots=True)
class ObjektResultat:
    """What became of one object of the set; `nvdb_id` of a new one is given once it was carried out."""

    temp_id: str | None
    nvdb_id: int | None
    versjon: int | None
    varsler: Varsler


@dataclass(frozen=True, slots=True)
class EndringssettStatus:
    """State of a change set, or the answer of the validator.

    Attributes
    ----------
    fremdrift : str
        Code of progress, ``AVVIST``, ``UTFØRT`` …
    arsak : str or None
        Why it was refused or waits, ``VALIDERINGSFEIL``, ``IKKE_AUTORISERT``, ``VENTER_PÅ_LÅS``.
    varsler : Varsler
        About no object in particular.
    objekter : tuple of ObjektResultat
    transaksjon_tid : datetime or None
        When NVDB took it, UTC: the time of reading for a later correction of the same objects.
    eier : str or None
    set_id : str or None
        None in the validator's answer.
    """

    fremdrift: str
    arsak: str | None = None
    varsler: Varsler = field(default_factory=Varsler)
    objekter: tuple[ObjektResultat, ...] = ()
    transaksjon_tid: datetime | None = None
    eier: str | None = None
    set_id: str | None = None

    @property
    def accepted(self) -> bool:
        """Whether it passed: for a set, that NVDB has taken it; for the validator, that it found no error."""
        return self.fremdrift in {UTFORT, UTFORT_OG_ETTERBEHANDLET}

    @property
    def nvdb_ids(self) -> Mapping[str, int]:
        """``tempId`` of each new object → the id that NVDB gave it."""
        return {
            item.temp_id: item.nvdb_id
            for item in self.objekter
            if item.temp_id is not None and item.nvdb_id is not None
        }

    def sentences(self) -> tuple[str, ...]:
        """Say it for people: first what became of the set, then every error, warning and note."""
        name = f"Change set {self.set_id}" if self.set_id else "The change set"
        why = f" ({self.arsak})" if self.arsak else ""
        found = [f"{name}: {self.fremdrift}{why}, {len(self.objekter)} objects."]
        found.extend(_sentences("the whole set", self.varsler))
        for item in self.objekter:
            known = "" if item.nvdb_id is None else f"{item.nvdb_id} version {item.versjon}"
            new = "" if item.temp_id is None else f"new {item.temp_id!r}"
            found.extend(_sentences(" ".join(part for part in (new, known) if part), item.varsler))
        return tuple(found)


def _sentences(where: str, varsler: Varsler) -> Iterator[str]:
    for kind, items in (
        ("error", varsler.feil),
        ("warning", varsler.advarsler),
        ("note", varsler.notabener),
    ):
        for item in items:
            yield f"{kind}, {where}: {item.melding} ({item.kode})"


def status_from_xml(document: bytes, *, set_id: str | None = None) -> EndringssettStatus:
    """Read an answer of ``/status`` or of the validator.

    Raises
    ------
    SchemaError
        Not XML, or not a status.
    """
    root = parse_xml(document, "The answer about the change set")
    if local_name(root) != "status":
        msg = f"API Skriv sent a {local_name(root)[:40]!r} instead of a status: check the API URL."
        raise SchemaError(msg)
    fremdrift = _text(root, "fremdrift")
    if not fremdrift:
        msg = "API Skriv sent a status without fremdrift: check the API URL."
        raise SchemaError(msg)
    result = _child(root, "resultat")
    transaction = _child(root, "transaksjon")
    return EndringssettStatus(
        fremdrift=fremdrift,
        arsak=_text(root, "avvistårsak") or _text(root, "venteårsak"),
        varsler=Varsler() if result is None else _varsler(result),
        objekter=() if result is None else tuple(_objekter(result)),
        transaksjon_tid=None if transaction is None else _utc(_text(transaction, "tidspunkt")),
        eier=_text(root, "eier"),
        set_id=set_id,
    )


@dataclass(frozen=True, slots=True)
class ListedSet:
    """A set as the search tells of it; `mottatt` is API Skriv's own time, as text that sorts."""

    set_id: str
    fremdrift: str
    mottatt: str


@dataclass(frozen=True, slots=True)
class SetContent:
    """What a client wrote into a set for itself: both references, and the names of its new objects."""

    ekstern_ref: str | None
    kontekst: str | None
    temp_ids: tuple[str, ...]


def listed_sets_from_xml(document: bytes) -> tuple[ListedSet, ...]:
    """Read a page of the search for sets; SchemaError for anything else."""
    root = parse_xml(document, "The list of change sets")
    if local_name(root) != "endringssettliste":
        msg = f"API Skriv sent a {local_name(root)[:40]!r} instead of a list of sets: check the API URL."
        raise SchemaError(msg)
    return tuple(_listed(item) for item in root if local_name(item) == "endringssett")


def set_content_from_xml(document: bytes) -> SetContent:
    """Read of a registered set what tells whose it is; SchemaError if it is none.

    The rest is not read: API Skriv adds its status, and may add more.
    """
    root = parse_xml(document, "The change set")
    if local_name(root) != "endringssett":
        msg = f"API Skriv sent a {local_name(root)[:40]!r} instead of a change set: check the API URL."
        raise SchemaError(msg)
    objects = (item for item in root.iter() if local_name(item) == "vegobjekt")
    names = dict.fromkeys(name for item in objects if (name := item.get("tempId")))
    return SetContent(_text(root, "eksternRef"), _text(root, "kontekst"), tuple(names))


def fremdrift_from_xml(document: bytes) -> str:
    """Read an answer of ``/fremdrift``; SchemaError for anything else."""
    root = parse_xml(document, "The answer about the progress")
    text = (root.text or "").strip()
    if local_name(root) != "fremdrift" or not text:
        msg = f"API Skriv sent a {local_name(root)[:40]!r} instead of a code of progress: check the API URL."
        raise SchemaError(msg)
    return text


def set_id_from_ressurser(document: bytes) -> str:
    """Take the id of a registered set from the links in the answer; SchemaError if there is none."""
    root = parse_xml(document, "The answer to the registration")
    links = {child.get("rel"): child.get("src", "") for child in root}
    match = _ID.search(links.get("self", ""))
    if local_name(root) != "ressurser" or match is None:
        msg = "API Skriv registered the change set without saying its address: look in its control panel."
        raise SchemaError(msg)
    return match.group(1)


def fault_messages(document: bytes) -> str:
    """Join the messages of a ``fault``; empty for any other body."""
    try:
        root = parse_xml(document, "The answer")
    except SchemaError:
        return ""
    if local_name(root) != "fault":
        return ""
    texts = (" ".join((child.text or "").split()) for child in root if local_name(child) == "message")
    return "; ".join(text for text in texts if text)[:500]


def _listed(item: Element) -> ListedSet:
    status = _child(item, "status")
    set_id, fremdrift = item.get("id"), None if status is None else _text(status, "fremdrift")
    if status is None or not set_id or not fremdrift:
        msg = "API Skriv listed a change set without its id or progress: look in its control panel."
        raise SchemaError(msg)
    return ListedSet(set_id, fremdrift, _text(status, "mottatt") or "")


def _child(element: Element, name: str) -> Element | None:
    return next((child for child in element if local_name(child) == name), None)


def _text(element: Element, name: str) -> str | None:
    child = _child(element, name)
    return (child.text or "").strip() or None if child is not None else None


def _utc(text: str | None) -> datetime | None:
    try:
        moment = datetime.fromisoformat(text or "")
    except ValueError:
        return None
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


def _varsler(element: Element) -> Varsler:
    return Varsler(*(_list(element, name) for name in ("feil", "advarsler", "notabener")))


def _list(element: Element, name: str) -> tuple[Varsel, ...]:
    wrapper = _child(element, name)
    return tuple(
        Varsel(
            kode=item.get("kode", ""),
            melding=_text(item, "melding") or "",
            referanse=_text(item, "referanse"),
            egenskap_type_id=_integer(_text(item, "egenskapTypeId")),
        )
        for item in (() if wrapper is None else wrapper)
    )


def _objekter(result: Element) -> Iterator[ObjektResultat]:
    wrapper = _child(result, "vegobjekter")
    for item in () if wrapper is None else wrapper:
        yield ObjektResultat(
            temp_id=item.get("tempId"),
            nvdb_id=_integer(item.get("nvdbId")),
            versjon=_integer(item.get("versjon")),
            varsler=_varsler(item),
        )


def _integer(text: str | None) -> int | None:
    return int(text) if text is not None and re.fullmatch(r"\d{1,18}", text) else None
