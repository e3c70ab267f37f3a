"""Answers of a local API Skriv, written in the documented form: Status, Fremdrift, Ressurser, fault."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree as ET

from nvdb.endringssett import FEIL, Endringssett, ValidationFinding
from nvdb.endringssett.write_tree import nvdb_time
from nvdb.endringssett.xml import NAMESPACE

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_FAULT_NAMESPACE: Final = "http://nvdb.vegvesen.no/apiskriv/fault/v1"


def _document(root: Element, namespace: str = NAMESPACE) -> bytes:
    root.set("xmlns", namespace)
    text = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8" standalone="yes"?>\n{text}\n'.encode()


def _sub(parent: Element, name: str, text: str | None = None) -> Element:
    made = ET.SubElement(parent, name)
    made.text = text
    return made


def fault_xml(message: str) -> bytes:
    """Write why a request was not taken."""
    root = ET.Element("fault")
    _sub(root, "message", message)
    return _document(root, _FAULT_NAMESPACE)


def fremdrift_xml(code: str) -> bytes:
    """Write the progress of a set."""
    root = ET.Element("fremdrift")
    root.text = code
    return _document(root)


def list_xml(sets: Iterable[tuple[str, str, datetime]], total: int) -> bytes:
    """Write a page of the search: id, code of progress and time of arrival of each set."""
    root = ET.Element("endringssettliste", antallTotalt=str(total))
    for set_id, code, received in sets:
        status = _sub(ET.SubElement(root, "endringssett", id=set_id), "status")
        _sub(status, "mottatt", nvdb_time(received))
        _sub(status, "fremdrift", code)
    return _document(root)


def ressurser_xml(base: str, set_id: str, relations: Iterable[str]) -> bytes:
    """Write the links of a set."""
    root = ET.Element("ressurser")
    for relation in relations:
        tail = "" if relation == "self" else f"/{relation}"
        ET.SubElement(root, "ressurs", rel=relation, src=f"{base}/rest/v3/endringssett/{set_id}{tail}")
    return _document(root)


def status_xml(
    sett: Endringssett,
    code: str,
    findings: Sequence[ValidationFinding],
    received: datetime,
    reason: str | None = None,
    made: Mapping[int, tuple[int, int]] | None = None,
    done: datetime | None = None,
) -> bytes:
    """Write the status of a set; `made`: index of a change → id and version that it led to."""
    root = ET.Element("status")
    _sub(root, "mottatt", nvdb_time(received))
    _sub(root, "fremdrift", code)
    if reason is not None:
        _sub(root, "avvistårsak", reason)
    result = _sub(root, "resultat")
    _varsler(result, [f for f in findings if f.temp_id is None and f.nvdb_id is None])
    objects = _sub(result, "vegobjekter")
    for index, endring in enumerate(sett.endringer):
        nvdb_id, versjon = (made or {}).get(index, (endring.nvdb_id, endring.versjon))
        named = {"tempId": endring.temp_id, "nvdbId": nvdb_id, "versjon": versjon}
        item = ET.SubElement(objects, "vegobjekt", {k: str(v) for k, v in named.items() if v is not None})
        mine = (endring.temp_id, endring.nvdb_id)
        about = [f for f in findings if any(mine) and (f.temp_id, f.nvdb_id) == mine]
        _varsler(item, about)
    _sub(root, "eier", "replay")
    _sub(root, "apiversjon", "3")
    transaction = _sub(root, "transaksjon")
    if done is not None:
        _sub(transaction, "oppdragId", "1")
        _sub(transaction, "tidspunkt", nvdb_time(done))
    return _document(root)


def _varsler(parent: Element, findings: Sequence[ValidationFinding]) -> None:
    wrappers = {name: _sub(parent, name) for name in ("feil", "advarsler", "notabener")}
    for finding in findings:
        name, wrapper = ("feil", "feil") if finding.severity == FEIL else ("advarsel", "advarsler")
        item = ET.SubElement(wrappers[wrapper], name, kode=finding.code)
        _sub(item, "melding", str(finding))
        if finding.egenskap_type_id is not None:
            _sub(item, "egenskapTypeId", str(finding.egenskap_type_id))
