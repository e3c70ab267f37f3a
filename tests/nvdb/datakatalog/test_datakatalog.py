"""Sign codes, ids, and the datakatalog that ships and is fetched."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from nvdb.datakatalog import (
    DATAKATALOG_VERSION,
    EGENSKAPER_95,
    EGENSKAPER_96,
    SKILTNUMMER_ENUM,
    Datakatalog,
    Egenskapstype,
    Stedfestingskrav,
    hent_datakatalog,
    is_retired,
    katalog_from_document,
    sign_code,
    sign_family,
    snapshot,
)
from nvdb.datakatalog.diff import diff
from nvdb.errors import SchemaError
from nvdb.replay import Fault


@pytest.mark.parametrize(
    ("verdi", "code", "family"),
    [
        ("362.50 - Fartsgrense, 50 km/t", "362.50", "362"),
        ("906H - Hindermarkering, hinder til høyre", "906H", "906"),
        ("727.3K - Administrativ grense. Kommunegrenseskilt", "727.3K", "727"),
        ("711.V90 - Tabellvegviser, Venstre, 90 grader", "711.V90", "711"),
        ("U722.2 - Vegviser for vegkryss", "U722.2", "U722"),
        ("202", "202", "202"),
        ("  512: Holdeplass", "512", "512"),
    ],
)
def test_sign_code_is_the_first_word(verdi: str, code: str, family: str) -> None:
    """The code is what stands before the description; its family is the number without the variant."""
    assert sign_code(verdi) == code
    assert sign_family(code) == family
    assert is_retired(code) == code.startswith("U")


@pytest.mark.parametrize("verdi", ["", "Annet", "- 362", "U", "12 - x", "362km", "Utgår 362"])
def test_sign_code_of_something_else_is_none(verdi: str) -> None:
    """Text that does not begin with a code gives none."""
    assert sign_code(verdi) is None


def test_sign_codes_of_the_snapshot_are_codes_with_ids_of_their_own() -> None:
    """Every shipped code reads as itself, and no enum id is used twice."""
    assert all(sign_code(f"{code} - x") == code for code in SKILTNUMMER_ENUM)
    assert len(set(SKILTNUMMER_ENUM.values())) == len(SKILTNUMMER_ENUM)
    assert 5530 in EGENSKAPER_96


def test_snapshot_knows_the_signs_and_says_which_version_it_is() -> None:
    """The shipped datakatalog has the constants' ids, and reads what it writes."""
    katalog = snapshot()
    assert (katalog.version, katalog.typer) == (DATAKATALOG_VERSION, {95: "Skiltpunkt", 96: "Skiltplate"})
    assert katalog.egenskapstyper.keys() >= EGENSKAPER_95.keys() | EGENSKAPER_96.keys()
    for code, enum_id in SKILTNUMMER_ENUM.items():
        assert sign_code(str(katalog.enum_value(5530, enum_id))) == code
    assert katalog.barn[220004] == katalog.barn[200004] == 96
    assert katalog.stedfesting == {95: Stedfestingskrav(None, "KAN", "KAN")}
    assert katalog_from_document(json.loads(json.dumps(katalog.to_document()))) == katalog


def test_snapshot_does_not_call_a_value_new_that_its_partial_list_lacks() -> None:
    """A partial list proves nothing; a property that is not listed at all is new."""
    katalog = snapshot()
    assert not katalog.is_unknown(5530, 99999)
    assert katalog.enum_value(5530, 99999) is None
    assert katalog.is_unknown(99999)
    assert Datakatalog("1", "", {1: Egenskapstype(1, 96, "x", "Tekstenum", {2: "a"})}, {}, {}).is_unknown(
        1, 3
    )


def test_hent_datakatalog_reads_what_the_api_says(api: Any) -> None:
    """Fetched from the API, the snapshot is itself again, with complete lists."""
    client, _ = api.serve({95: [], 96: []})
    fetched = hent_datakatalog(client)
    kinds = {number: replace(kind, complete=True) for number, kind in snapshot().egenskapstyper.items()}
    assert fetched == replace(snapshot(), egenskapstyper=kinds)
    assert diff(snapshot(), fetched) == []


@pytest.mark.parametrize(
    "body", [b"[]", b'{"id":1}', b'{"versjon":"2.41","dato":"2026-01-01","egenskapstyper":[{"navn":"x"}]}']
)
def test_hent_datakatalog_refuses_an_answer_of_another_form(api: Any, body: bytes) -> None:
    """An answer without version or property ids is a SchemaError."""
    client, _ = api.serve({95: []}, lambda info: Fault("status", 200, body=body))
    with pytest.raises(SchemaError):
        hent_datakatalog(client)


def test_hent_datakatalog_reads_what_a_place_has_to_say(api: Any) -> None:
    """Whether a type wants a direction, a side, lanes is in its stedfesting, or in what a list holds."""
    krav = {"retning_relevant": True, "sideposisjon_relevant": "KAN", "kjørefelt_relevant": "NEI"}
    for stedfesting in (krav, {"egenskapstype": "Liste", "innhold": krav}):
        body = json.dumps({"versjon": "2.41", "navn": "x", "stedfesting": stedfesting}).encode()
        client, _ = api.serve({95: []}, lambda info, body=body: Fault("status", 200, body=body))
        fetched = hent_datakatalog(client, (95,))
        assert fetched.stedfesting == {95: Stedfestingskrav(True, "KAN", "NEI")}


def test_diff_says_what_changed() -> None:
    """New, gone and renamed properties and values are told one by one; gaps of a partial list are counted."""

    def katalog(version: str, *kinds: Egenskapstype) -> Datakatalog:
        return Datakatalog(version, "", {kind.id: kind for kind in kinds}, {}, {96: "Skiltplate"})

    old = katalog(
        "2.38",
        Egenskapstype(1, 96, "Farge", "Tekstenum", {10: "Rød", 11: "Blå"}),
        Egenskapstype(2, 96, "Nummer", "Tekstenum", {20: "362.50"}, complete=False),
        Egenskapstype(3, 96, "Borte", "Tekst"),
    )
    new = katalog(
        "2.41",
        Egenskapstype(1, 96, "Farge", "Tekstenum", {10: "Raud", 12: "Gul"}),
        Egenskapstype(2, 96, "Nummer", "Tekstenum", {20: "362.50 - Fartsgrense", 21: "202 - Vikeplikt"}),
        Egenskapstype(4, 96, "Ny", "Tekst"),
    )
    assert diff(old, new) == [
        "The datakatalog went from 2.38 to 2.41.",
        "Enum 12 'Gul' of egenskap 1 'Farge' is new.",
        "Enum 11 'Blå' of egenskap 1 'Farge' is gone.",
        "Enum 10 of egenskap 1 'Farge' was 'Rød' and is 'Raud'.",
        "1 enum values of egenskap 2 'Nummer' are known now that the older list lacked.",
        "Egenskap 3 'Borte' of type 96 is gone.",
        "Egenskap 4 'Ny' of type 96 is new.",
    ]
    assert diff(new, new) == []
