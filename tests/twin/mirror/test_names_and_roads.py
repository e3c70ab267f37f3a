"""Names of sign codes and roads of findings: from the source that holds, and none that is guessed."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest
import sqlalchemy as sa
from command_line import Twin
from findings import finding
from store_rows import row

from nvdb.datakatalog import snapshot
from twin.decisions.findings import latest_findings
from twin.matching.save import save_changes
from twin.mirror.names import KATALOG_FACT, sign_names
from twin.mirror.raw import packed
from twin.mirror.roads import Road, roads_of
from twin.store import schema
from twin.store.store import Store


def with_plates(store: Store, *texts: str) -> None:
    """Mirror plates that carry these values of 5530."""
    plates = [
        row(schema.skiltplate, nvdb_id=k, skiltnummer=text.split()[0], skiltnummer_text=text)
        for k, text in enumerate(texts)
    ]
    with store.transaction() as connection:
        connection.execute(sa.insert(schema.skiltplate), plates)


def with_katalog(store: Store, values: dict[int, str]) -> None:
    """Let a sync have fetched a datakatalog with these codes."""
    katalog = snapshot()
    kind = replace(katalog.egenskapstyper[5530], verdier=values)
    fetched = replace(katalog, egenskapstyper={**katalog.egenskapstyper, 5530: kind})
    with store.transaction() as connection:
        store.put_fact(connection, KATALOG_FACT, fetched.to_document())


def test_fetched_datakatalog_has_the_word(empty: Store) -> None:
    """Its name counts, not the mirror's; what it does not know has the shipped one's."""
    with_katalog(empty, {1: "142 - Barn leker", 2: "560 - Opplysningstavle"})
    with_plates(empty, "142 - Noe annet")
    names = sign_names(empty)
    assert (names["142"], names["560"], names["202"]) == ("Barn leker", "Opplysningstavle", "Vikeplikt")


def test_mirror_names_codes_that_the_datakatalog_has_without_a_name(empty: Store) -> None:
    """Of the codes that findings have; one that nobody names stays without."""
    with_katalog(empty, {1: "204"})
    with_plates(empty, "204 - Stopp", "212 - Vikeplikt for møtende kjørende")
    found = [finding("a", skiltnummer_seen=("204", "999"))]
    save_changes(empty, found, {}, {"method": "m", "at": "2026-06-11T00:00:00Z"})
    names = sign_names(empty)
    assert names["204"] == "Stopp"
    assert "999" not in names
    assert "212" not in names


def test_road_is_that_of_nvdbs_object_with_its_street(empty: Store) -> None:
    """As Les V4 gives it; an object of Uberiket has neither, and a new sign has no object."""
    v4 = {"lokasjon": {"adresser": [{"id": 1, "adressekode": 1500, "navn": "Elgeseter gate"}]}}
    points = [
        row(schema.skiltpunkt, nvdb_id=1, road_reference="FV6680 S1D1 m120", raw=packed(v4)),
        row(schema.skiltpunkt, nvdb_id=2, road_reference=None, raw=packed({"typeId": 95})),
    ]
    with empty.transaction() as connection:
        connection.execute(sa.insert(schema.skiltpunkt), points)
    found = [finding(str(k), nvdb_id=k or None) for k in range(3)]
    roads = roads_of(empty, found)
    assert roads == {"0": Road(), "1": Road("FV6680 S1D1 m120", "Elgeseter gate"), "2": Road()}
    assert str(roads["1"]) == "FV6680 S1D1 m120, Elgeseter gate"


def test_new_sign_has_the_reference_of_the_road_beside_it(matched_road: Path) -> None:
    """With the road network in the store; far from every road there is none."""
    with Store.open(matched_road) as store:
        found = [one.finding for one in latest_findings(store.rows) if one.finding.nvdb_id is None]
        assert found
        away = replace(found[0], change_id="away", east_m=found[0].east_m + 5000)
        roads = roads_of(store, [*found, away])
    assert roads["away"] == Road()
    assert all(roads[one.change_id].reference.startswith(("E", "F", "K", "R")) for one in found)


@pytest.mark.parametrize("command", [["findings"], ["decide", "dismiss", "--verdict", "new", "--dry-run"]])
def test_lists_are_norwegian_where_asked(
    twin: Twin, store: Path, command: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the option or the environment; English is what nobody has to ask for."""
    monkeypatch.setenv("COLUMNS", "400")
    assert "no sign of NVDB within" in twin(*command, "--store", store).out
    norsk = twin(*command, "--lang", "nb", "--store", store)
    monkeypatch.setenv("TWIN_LANG", "nb")
    assert twin(*command, "--store", store).out == norsk.out
    assert "142 – Barn" in norsk.out
    assert "står ikke i NVDB" in norsk.out
    assert "Sett 10. juni 2026 av to kameraer." in norsk.out


def test_export_is_norwegian_where_asked(twin: Twin, store: Path, tmp_path: Path) -> None:
    """Reasons and names of columns; verdicts and decisions are the values that programs read."""
    for lang in ("en", "nb"):
        assert twin("export", tmp_path / lang, "--lang", lang, "--store", store).code == 0
    english, norsk = (
        {one["id"]: one["properties"] for one in json.loads(path.read_text())["features"]}
        for path in (tmp_path / lang / "changes.geojson" for lang in ("en", "nb"))
    )
    assert english.keys() == norsk.keys()
    for key, one in norsk.items():
        assert {**one, "reason": ""} == {**english[key], "reason": ""}
        assert one["reason"] != english[key]["reason"]
    assert any("142 – Barn" in one["reason"] for one in norsk.values())
    with sqlite3.connect(tmp_path / "nb" / "twin_utm33.gpkg") as database:
        (qml,) = database.execute(
            "SELECT styleQML FROM layer_styles WHERE f_table_name = 'changes'"
        ).fetchone()
    assert 'name="Begrunnelse"' in qml
