"""Recorded answers of Uberiket V1 (of other types than signs: no sign has been recorded)."""

from __future__ import annotations

import json
from typing import Any

import pytest
from checkout import REAL

from nvdb.datakatalog import snapshot
from nvdb.errors import SchemaError
from nvdb.objects import skilt_from_uberiket, vegobjekt_from_uberiket

FOLDER = REAL / "nvdb" / "uberiket_tnits"


@pytest.fixture(scope="module")
def recorded() -> list[dict[str, Any]]:
    """All recorded vegobjekter."""
    paths = sorted(FOLDER.glob("vegobjekt-*.json"))
    if not paths:
        pytest.skip("the recorded Uberiket answers are not beside the repository")
    return [json.loads(path.read_text(encoding="utf-8")) for path in paths]


def test_recorded_uberiket_objects_parse_whole(recorded: list[dict[str, Any]]) -> None:
    """Id, type, version, dates, every property and every place on the network are read as they stand."""
    assert len(recorded) == 27
    for raw in recorded:
        vegobjekt = vegobjekt_from_uberiket(raw, snapshot())
        assert (vegobjekt.id, vegobjekt.type_id, vegobjekt.versjon) == (
            raw["id"],
            raw["typeId"],
            raw["versjon"],
        )
        assert vegobjekt.startdato == raw["gyldighetsperiode"]["startdato"]
        assert vegobjekt.sist_modifisert == raw["sistEndret"]
        assert {str(number) for number in vegobjekt.egenskaper} == set(raw["egenskaper"])
        for number, item in raw["egenskaper"].items():
            egenskap = vegobjekt.egenskaper[int(number)]
            value = egenskap.enum_id if item["type"] == "EnumEgenskap" else egenskap.verdi
            assert value == item["verdi"]
        lines = [
            (line.veglenkesekvensid, line.startposisjon, line.sluttposisjon, line.retning)
            for line in vegobjekt.stedfestinger
        ]
        assert lines == [
            (line["id"], line["startposisjon"], line["sluttposisjon"], line.get("retning"))
            for line in raw["stedfesting"]["linjer"]
        ]


def test_recorded_uberiket_objects_are_not_taken_for_signs(recorded: list[dict[str, Any]]) -> None:
    """An object of another type is refused as a plate, by its own word."""
    with pytest.raises(SchemaError, match=r"is of type \d+, not 96"):
        skilt_from_uberiket(recorded[0], 96, snapshot())
