"""The documented examples of API Skriv V3: read, written again, and compared element for element."""

from __future__ import annotations

import json
import re
from typing import Any
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import pytest
from checkout import REAL

from nvdb.endringssett import errors, from_json, from_xml, to_json, to_xml, validate
from nvdb.endringssett.rules import ANBEFALT, GRENSER, OBLIGATORISK
from nvdb.skriv import status as skriv_status

NVDB = REAL / "nvdb"
EXAMPLES = NVDB / "skriv_v3_examples"
DOCS = NVDB / "skriv_v3_docs"

pytestmark = pytest.mark.skipif(not EXAMPLES.is_dir(), reason="the Skriv examples are not on this machine")

ANY_ORDER = {"endringssett", "vegobjekt", "geometri", "kvalitet"}
"""Elements whose members the schema takes in any order (``xs:all``), or that the docs show in several."""


def _form(element: Element) -> Any:
    """Name with namespace, attributes, text and members of an element, for comparison."""
    members = [_form(child) for child in element]
    if element.tag.rpartition("}")[2] in ANY_ORDER:
        members.sort(key=str)
    text = (element.text or "").strip()
    return element.tag, dict(element.attrib), text, members


def _same(one: bytes, other: bytes) -> None:
    forms = [_form(defusedxml.ElementTree.fromstring(document)) for document in (one, other)]
    assert forms[0] == forms[1]


@pytest.mark.parametrize("name", ["registrer_skiltpunkt_95.xml", "registrer_skiltplate_96.xml"])
def test_example_files_are_written_as_they_were_read(name: str) -> None:
    """Every element, attribute, text and namespace of the documented signs comes back."""
    document = (EXAMPLES / name).read_bytes()
    _same(to_xml(from_xml(document)), document)


@pytest.mark.parametrize(
    "name",
    [
        "generator_testcase00_registrer.json",
        "delvisOppdater_overskriv_example.json",
        "SHAPE_delvisKorriger_geometri.json",
        "lukk_andreryg_2025.json",
    ],
)
def test_example_json_is_written_as_it_was_read(name: str) -> None:
    """Every word and value of the JSON examples comes back, and their XML says the same."""
    document = json.loads((EXAMPLES / name).read_text(encoding="utf-8"))
    document.pop("_comment", None)
    sett = from_json(json.dumps(document))
    assert json.loads(to_json(sett)) == document
    assert from_xml(to_xml(sett)) == sett


def _snippets() -> list[str]:
    """Whole change sets and operations on points that the documentation shows as XML."""
    names = "endringssett|registrer|oppdater|delvisOppdater|lukk|korriger|delvisKorriger|fjern"
    found: list[str] = []
    for name in ("oppbygging", "api-referanse", "migrering_fra_v2"):
        path = DOCS / f"endringssett_{name}.md"
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        for block in re.findall(r"```xml\n(.*?)```", text, re.DOTALL):
            whole = re.search(rf"<({names})\b[^>]*>.*</\1>", block, re.DOTALL)
            if whole and not re.search(r"\.\.\.|<linje|vegObjekt|endringssett id=", whole.group()):
                found.append(whole.group())
    return found


@pytest.mark.parametrize("snippet", _snippets(), ids=lambda text: re.findall(r"[a-zA-Z]+", text)[0])
def test_whole_snippets_of_the_documentation_are_written_as_they_were_read(snippet: str) -> None:
    """Operations that the documentation shows whole survive, once they stand in a change set."""
    # One snippet has `operasjon` on the vegobjekt too, which no other text or example has.
    snippet = snippet.replace(' versjon="1" operasjon="oppdater">', ' versjon="1">')
    if not snippet.startswith("<endringssett"):
        snippet = f"<endringssett><datakatalogversjon>2.20</datakatalogversjon>{snippet}</endringssett>"
    if "xmlns" not in snippet:
        namespace = "http://nvdb.vegvesen.no/apiskriv/domain/changeset/v3"
        snippet = snippet.replace("<endringssett", f'<endringssett xmlns="{namespace}"', 1)
    # A set that was fetched carries its status with it, which is read elsewhere.
    snippet = re.sub(r"<status\b.*</status>", "", snippet, flags=re.DOTALL)
    _same(to_xml(from_xml(snippet.encode())), snippet.encode())


def test_the_documentation_has_whole_snippets_of_most_operations() -> None:
    """The test above is not empty: it sees registrer, delvisOppdater, lukk and fjern."""
    text = "".join(_snippets())
    for operasjon in ("registrer", "delvisOppdater", "lukk", "fjern"):
        assert f"<{operasjon}>" in text


def test_the_validator_finds_what_is_wrong_with_the_documented_signs() -> None:
    """The documented plate has east and north exchanged, and no Skiltpunkt names it."""
    point = validate(from_xml((EXAMPLES / "registrer_skiltpunkt_95.xml").read_bytes()))
    assert {f.code for f in errors(point)} == {"MANGLER_STEDFESTING", "UGYLDIG_KVALITETSPARAMETER"}
    plate = validate(from_xml((EXAMPLES / "registrer_skiltplate_96.xml").read_bytes()))
    assert {f.code for f in errors(plate)} == {
        "MANGLER_STEDFESTING", "MANGLER_MOROBJEKT", "GEOMETRI_UTENFOR_OMRISSET_AV_EUREF89_UTM33N",
    }  # fmt: skip


def test_limits_are_those_of_the_type_definition() -> None:
    """Lengths, decimals, minima, maxima and wanted properties of 95 are as the datakatalog says."""
    path = NVDB / "datakatalog" / "vegobjekttype_95_les_v3.json"
    kinds = {kind["id"]: kind for kind in json.loads(path.read_text(encoding="utf-8"))["egenskapstyper"]}
    for number, limits in GRENSER.items():
        kind = kinds[number]
        assert kind["feltlengde"] == limits.feltlengde
        assert kind.get("desimaler") == limits.desimaler
        assert kind.get("min") == limits.minst
        assert kind.get("maks") == ("Infinity" if number == 10428 else limits.hoyst)
    limited = {n for n, k in kinds.items() if k["egenskapstype"] in {"Tekst", "Heltall", "Flyttall"}}
    assert {n for n in limited if "tillatte_verdier" not in kinds[n]} == set(GRENSER)
    by_importance = {
        word: {
            n for n, kind in kinds.items() if kind["viktighet"] == word and kind["egenskapstype"] != "Liste"
        }
        for word in ("PÅKREVD_ABSOLUTT", "PÅKREVD_IKKE_ABSOLUTT")
    }
    assert by_importance["PÅKREVD_ABSOLUTT"] == OBLIGATORISK[95]
    assert by_importance["PÅKREVD_IKKE_ABSOLUTT"] == ANBEFALT[95]


def _answers(*words: str) -> list[bytes]:
    """XML answers in the documentation whose root is one of `words`, the set that one stands in left out."""
    text = "".join(path.read_text(encoding="utf-8") for path in sorted(DOCS.glob("endringssett_*.md")))
    found = re.findall(rf"^<({'|'.join(words)})\b([^>]*)>(.*?)</\1>", text, re.DOTALL | re.MULTILINE)
    return [f"<{word}{attributes}>{inner}</{word}>".encode() for word, attributes, inner in found]


def test_documented_statuses_are_read() -> None:
    """The refused and the finished example: codes, messages, the new id and the time in UTC."""
    statuses = [skriv_status.status_from_xml(answer) for answer in _answers("status")]
    refused = next(status for status in statuses if status.fremdrift == "AVVIST")
    assert (refused.arsak, refused.eier, refused.accepted) == ("VALIDERINGSFEIL", "exttxa", False)
    (item,) = refused.objekter
    (feil,) = item.varsler.feil
    assert (item.temp_id, feil.kode, feil.egenskap_type_id) == ("tunnel#1", "UKJENT_EGENSKAPSTYPE", 0)
    assert feil.melding == "Egenskapstypen 0 finnes ikke i datakatalogen"
    done = next(status for status in statuses if status.nvdb_ids)
    assert done.accepted
    assert done.nvdb_ids == {"tunnel#1": 4587234667}
    assert str(done.transaksjon_tid) == "2020-05-29 10:27:17+00:00"
    warned = next(status for status in statuses if status.varsler.advarsler)
    assert warned.varsler.advarsler[0].kode == "IKKE_GJELDENDE_DATAKATALOGVERSJON"
    assert [item.varsler.advarsler[0].kode for item in warned.objekter] == [
        "MANGLER_BETINGET_PÅKREVDE_EGENSKAPER"
    ]


def test_documented_links_progress_and_faults_are_read() -> None:
    """Every ressurser, fremdrift and fault of the documents gives its id, code or message."""
    document = (EXAMPLES / "ressurser_201_created.xml").read_bytes()
    assert skriv_status.set_id_from_ressurser(document) == "63de0209-18b3-43d7-9944-69a3bc6d4037"
    links = _answers("ressurser")
    assert len(links) >= 3
    assert {skriv_status.set_id_from_ressurser(answer) for answer in links} == {
        "63de0209-18b3-43d7-9944-69a3bc6d4037"
    }
    (code,) = _answers("fremdrift")
    assert skriv_status.fremdrift_from_xml(code) == "BEHANDLES"
    text = (DOCS / "feilhaandtering.md").read_text(encoding="utf-8")
    fault = re.search(r"<fault\b.*</fault>", text, re.DOTALL)
    assert fault is not None
    said = skriv_status.fault_messages(fault.group().encode())
    assert said.startswith("registrer.vegobjekter[0].stedfesting")
