"""Accepted findings of the sample become change sets that say what was found, and nothing else."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path

import pytest
import sqlalchemy as sa
from command_line import Twin
from findings import finding

from nvdb.datakatalog import Ansiktsside, katalog_from_document, snapshot
from nvdb.endringssett import (
    Assosiasjon,
    Datter,
    Egenskap,
    Endring,
    Endringssett,
    from_json,
    from_xml,
    validate,
)
from twin.changesets import ChangeSets, files_of, groups_from_store
from twin.changesets.drive_side import std_in_plan_m
from twin.changesets.operations import is_correction, merged
from twin.changesets.places import RoadPlaces
from twin.export import FILES
from twin.store import schema
from twin.store.store import Store

DAY = date(2026, 6, 10)
MOVED, WRONG_PLATE, MISSING, THREE_PLATES = 1042500106, 1042600114, 1042500115, 1042500105
SETS = [
    "datafangst-1.geojson",
    "endringssett-1-before.json",
    "endringssett-1.json",
    "endringssett-1.xml",
    "proveniens.json",
]


def made_from(path: Path, decision: str = "accept") -> ChangeSets:
    """What the store's findings become."""
    with Store.open(path) as opened:
        return groups_from_store(opened, decision)


def change(path: Path, *statements: str, matched: bool = False) -> None:
    """Write to the store behind twin's back; or as a sync does, so that the next match looks at it."""
    with Store.open(path) as store, store.transaction() as connection:
        for statement in statements:
            connection.exec_driver_sql(statement)
        if matched:
            store.touch(connection)


def accept_all(twin: Twin, path: Path) -> None:
    """Accept every finding that is open."""
    verdicts = [part for name in ("new", "missing", "moved", "wrong_type") for part in ("--verdict", name)]
    assert twin("decide", "accept", *verdicts, "--by", "kari", "--store", path).code == 0


def operations(made: ChangeSets) -> list[tuple[str, int, int | None]]:
    """Operation, type and id of every change."""
    return [(e.operasjon, e.type_id, e.nvdb_id) for item in made.setts for e in item.sett.endringer]


def exported(folder: Path) -> list[str]:
    """Names of the files of change sets."""
    return sorted(path.name for path in folder.iterdir() if path.name not in FILES)


def test_every_verdict_becomes_its_operation(twin: Twin, road_store: Path) -> None:
    """Wrong type and move update, a new pole is registered with its plates, what is missing is closed."""
    accept_all(twin, road_store)
    made = made_from(road_store)
    assert made.left_out == ()
    assert sorted(operations(made), key=str) == [
        ("delvisOppdater", 95, MOVED),
        ("delvisOppdater", 96, 1042600108),
        ("delvisOppdater", 96, WRONG_PLATE),
        ("lukk", 95, MISSING),
        ("registrer", 95, None),
        ("registrer", 96, None),
        ("registrer", 96, None),
    ]
    (item,) = made.setts
    assert (item.errors, item.not_undone) == ((), ())
    assert {e.startdato or e.lukkedato for e in item.sett.endringer} == {DAY}
    places = {e.stedfesting for e in item.sett.endringer if e.nvdb_id in {MOVED, 1042600108}}
    assert len(places) == 1
    (punkt,) = next(iter(places)).punkter
    assert (punkt.veglenkesekvens_id, punkt.retning, punkt.sideposisjon) == (3041771, "MED", "H")
    assert abs(punkt.posisjon - 0.203) < 0.001  # 3 m before NVDB's place, of 1,000 m


def test_new_sign_says_which_traffic_it_is_for(twin: Twin, road_store: Path) -> None:
    """The car drove with the road: direction and side of pole and plates, and the plates' Ansiktsside."""
    assert twin("decide", "accept", "--verdict", "new", "--by", "kari", "--store", road_store).code == 0
    made = made_from(road_store)
    assert [warning.partition(" lacks")[2].partition(",")[0] for warning in made.setts[0].warnings] == [
        " the property 1876 Oppsettingsutstyr"
    ]
    new = made.setts[0].sett.endringer
    for endring in new:
        assert endring.stedfesting is not None
        (punkt,) = endring.stedfesting.punkter
        assert (punkt.retning, punkt.sideposisjon) == ("MED", "H")
    sides = [e.enum for endring in new for e in endring.egenskaper if e.type_id == 1894]
    assert sides == [(2714,), (2714,)]


def test_sign_seen_from_both_sides_gets_no_direction(twin: Twin, road_store: Path) -> None:
    """Half of the cameras behind it: which traffic it is for is not guessed, and the warning says so."""
    mirrored = ", ".join(
        f"eye_{axis}_m = 2 * (SELECT {axis}_m FROM estimate AS e WHERE e.drive_id = sighting.drive_id "
        f"AND e.object = sighting.object AND e.method = sighting.method) - eye_{axis}_m"
        for axis in ("east", "north")
    )
    change(road_store, f"UPDATE sighting SET {mirrored} WHERE number / 2 * 2 = number")
    assert twin("decide", "accept", "--verdict", "new", "--by", "kari", "--store", road_store).code == 0
    made = made_from(road_store)
    assert made.left_out == ()
    for endring in made.setts[0].sett.endringer:
        assert endring.stedfesting is not None
        assert [(p.retning, p.sideposisjon) for p in endring.stedfesting.punkter] == [(None, "H")]
        assert 1894 not in {egenskap.type_id for egenskap in endring.egenskaper}
    assert sum("says no retning" in warning for warning in made.setts[0].warnings) == 3


@pytest.mark.parametrize(
    ("face_deg", "retning", "ansiktsside"),
    [
        (225.0, "MED", Ansiktsside.MED_METRERINGSRETNING),
        (45.0, "MOT", Ansiktsside.MOT_METRERINGSRETNING),
        (135.0, None, None),
        (None, None, None),
    ],
)
def test_place_says_the_direction_of_the_traffic_that_reads_a_face(
    road_store: Path, face_deg: float | None, retning: str | None, ansiktsside: Ansiktsside | None
) -> None:
    """The main road runs to the north-east: a face to the south-west is for those who follow it."""
    with Store.open(road_store) as opened:
        places = RoadPlaces(opened)
        rows = opened.rows(sa.select(schema.skiltpunkt).where(schema.skiltpunkt.c.nvdb_id == MOVED))
        where = rows[0]["east_m"], rows[0]["north_m"], DAY
        assert places.place(*where, face_deg=face_deg).retning == retning
        assert places.ansiktsside(*where, face_deg) == ansiktsside


def test_geometry_says_how_well_it_is_known(twin: Twin, road_store: Path) -> None:
    """Accuracy in whole centimetres from our covariance, rounded up; no height, no quality of a height."""
    accept_all(twin, road_store)
    made = made_from(road_store)
    moved = next(one for one in made.findings.values() if one.verdict == "moved")
    std_cm = 100 * std_in_plan_m(moved)
    for endring in (e for e in made.setts[0].sett.endringer if e.nvdb_id in {MOVED, 1042600108}):
        (geometri,) = (e.geometri for e in endring.egenskaper if e.geometri is not None)
        kvalitet = geometri.kvalitet
        assert kvalitet is not None
        assert std_cm <= (kvalitet.noyaktighet_cm or 0) < std_cm + 1
        assert ("Z" in geometri.wkt) == (kvalitet.noyaktighet_hoyde_cm is not None)
        assert geometri.datafangstdato == DAY


def test_without_a_road_network_only_what_needs_a_place_is_left_out(twin: Twin, store: Path) -> None:
    """New and moved name the cure; the others go."""
    accept_all(twin, store)
    made = made_from(store)
    assert [kind for kind, _, _ in operations(made)] == ["delvisOppdater", "lukk"]
    assert len(made.left_out) == 2
    for item in made.left_out:
        assert item.sentence.startswith(item.change_id)
        assert "twin sync-nvdb --vegnett" in item.sentence


def test_badly_measured_sign_is_corrected_not_moved(twin: Twin, store: Path) -> None:
    """Within three of NVDB's sigmas and twice as well measured: the same version, as of when it was read."""
    worse = f"UPDATE skiltpunkt SET accuracy_cm=100, capture_method='ukj' WHERE nvdb_id={MOVED}"
    change(store, worse, matched=True)
    assert twin("match", "--store", store).code == 0
    assert twin("decide", "accept", "--verdict", "moved", "--by", "kari", "--store", store).code == 0
    made = made_from(store)
    assert operations(made) == [("delvisKorriger", 95, MOVED), ("delvisKorriger", 96, 1042600108)]
    with Store.open(store) as opened:
        rows = opened.rows(sa.select(schema.skiltpunkt.c.nvdb_id, schema.skiltpunkt.c.synced_at))
        rows += opened.rows(sa.select(schema.skiltplate.c.nvdb_id, schema.skiltplate.c.synced_at))
    read = {row["nvdb_id"]: datetime.fromisoformat(row["synced_at"]) for row in rows}
    for endring in made.setts[0].sett.endringer:
        assert endring.lest_fra_nvdb == read[endring.nvdb_id]
        assert (endring.startdato, endring.stedfesting) == (None, None)


@pytest.mark.parametrize(
    ("ours_m", "nvdb_m", "distance_m", "wanted"),
    [(0.5, 1.0, 3.0, True), (0.51, 1.0, 3.0, False), (0.1, 1.0, 3.01, False), (0.1, 0.1, 0.2, False)],
)
def test_correction_needs_a_much_better_position_nearby(
    ours_m: float, nvdb_m: float, distance_m: float, wanted: bool
) -> None:
    """Half of NVDB's standard deviation, and no further than three of them."""
    moved = finding(
        covariance_m2=(ours_m**2 * 0.36, 0.0, ours_m**2 * 0.64),
        distance_m=distance_m,
        terms={"nvdb_sigma_m": nvdb_m},
    )
    assert is_correction(moved) is wanted


def test_findings_about_one_pole_make_one_operation_a_version(twin: Twin, store: Path) -> None:
    """A new plate, a plate of another code: one update of the pole, in one group, at NVDB's own place."""
    change(
        store,
        "DELETE FROM skiltplate WHERE nvdb_id=1042600107",
        f"UPDATE skiltpunkt SET plate_ids='[1042600105, 1042600106]' WHERE nvdb_id={THREE_PLATES}",
        "UPDATE skiltplate SET skiltnummer='202' WHERE nvdb_id=1042600106",
        matched=True,
    )
    changes = twin("match", "--store", store, "--json").json["changes"]
    about = [c for c in changes if c["verdict"] in {"new", "wrong_type"} and c["nvdb_id"] != WRONG_PLATE]
    about = [c for c in about if c["nvdb_type"] == 96]
    assert sorted(c["verdict"] for c in about) == ["new", "wrong_type"]
    ids = [c["change_id"] for c in about]
    assert twin("decide", "accept", *ids, "--by", "kari", "--store", store).code == 0
    made = made_from(store)
    assert made.left_out == ()
    assert operations(made) == [
        ("delvisOppdater", 96, 1042600106),
        ("delvisOppdater", 95, THREE_PLATES),
        ("registrer", 96, None),
    ]
    (group,) = made.setts[0].groups
    assert sorted(group.change_ids) == sorted(ids)
    registered = group.endringer[-1]
    assert registered.stedfesting is not None
    assert registered.stedfesting.punkter[0].posisjon == 0.178
    assert made.setts[0].errors == ()


def test_merged_update_takes_a_correction_in() -> None:
    """A correction beside an update becomes part of it; what is closed is only closed."""
    where = Egenskap(type_id=4794, operasjon="oppdater")
    correction = Endring(
        operasjon="delvisKorriger", type_id=95, nvdb_id=1, versjon=2, lest_fra_nvdb=datetime.now(UTC),
        egenskaper=(where,),
    )  # fmt: skip
    child = Assosiasjon(type_id=220004, dotre=(Datter(temp_id="a", operasjon="ny"),), operasjon="oppdater")
    update = Endring(
        operasjon="delvisOppdater", type_id=95, nvdb_id=1, versjon=2, startdato=DAY, assosiasjoner=(child,)
    )
    other = replace(update, assosiasjoner=(replace(child, dotre=(Datter(temp_id="b", operasjon="ny"),)),))
    both = replace(child, dotre=(*child.dotre, *other.assosiasjoner[0].dotre))
    assert merged([correction, update, other]) == (
        replace(update, egenskaper=(where,), assosiasjoner=(both,)),
    )
    closed = Endring(operasjon="lukk", type_id=95, nvdb_id=1, versjon=2, lukkedato=DAY)
    assert merged([closed, update]) == merged([update, closed]) == (closed,)


@pytest.mark.parametrize(
    ("statement", "cure"),
    [
        ("UPDATE skiltplate SET start_date='2026-06-10' WHERE nvdb_id=1042600114", "defer it until"),
        ("UPDATE skiltplate SET version=NULL WHERE nvdb_id=1042600114", "twin sync-nvdb"),
        ("UPDATE change SET skiltnummer_seen='999.77' WHERE verdict='wrong_type'", "correct the code"),
        ("UPDATE change SET skiltnummer_seen='' WHERE verdict='wrong_type'", "annotate it"),
    ],
)
def test_what_cannot_be_sent_is_left_out_with_its_cure(
    twin: Twin, store: Path, statement: str, cure: str
) -> None:
    """NVDB is newer than the drive, no version, a code that is not known, no code at all."""
    assert twin("decide", "accept", "--verdict", "wrong_type", "--by", "kari", "--store", store).code == 0
    change(store, statement)
    made = made_from(store)
    assert made.setts == ()
    (item,) = made.left_out
    assert cure in item.sentence


def test_a_synced_store_has_the_whole_datakatalog(store: Path) -> None:
    """What the API gave is kept as complete, even where it brought nothing that was not known before."""
    with Store.open(store) as opened:
        fact = opened.fact("datakatalog")
    assert fact is not None
    katalog = katalog_from_document(fact)
    assert all(kind.complete for kind in katalog.egenskapstyper.values())
    assert katalog.stedfesting == snapshot().stedfesting


def test_a_code_that_only_the_whole_datakatalog_has_says_sync_first(twin: Twin, store: Path) -> None:
    """With the shipped list alone a rare code is not wrong, only unknown; a sync brings all of them."""
    assert twin("decide", "accept", "--verdict", "wrong_type", "--by", "kari", "--store", store).code == 0
    change(store, "UPDATE change SET skiltnummer_seen='999.77' WHERE verdict='wrong_type'")
    with Store.open(store) as opened, opened.transaction() as connection:
        opened.put_fact(connection, "datakatalog", snapshot().to_document())
    (item,) = made_from(store).left_out
    assert "sync with NVDB first" in item.sentence
    with Store.open(store) as opened, opened.transaction() as connection:
        document = snapshot().to_document()
        document["vegobjekttyper"]["96"]["egenskapstyper"]["5530"]["verdier"]["77777"] = "999.77 - X"
        opened.put_fact(connection, "datakatalog", document)
    made = made_from(store)
    assert made.left_out == ()
    assert [item.enum for item in made.setts[0].sett.endringer[0].egenskaper] == [(77777,)]


def test_export_without_acceptance_writes_no_change_set(twin: Twin, store: Path, tmp_path: Path) -> None:
    """Nothing that nobody accepted; what was accepted and taken back is removed from the folder."""
    out = tmp_path / "out"
    assert twin("export", out, "--store", store).code == 0
    assert exported(out) == []
    assert twin("decide", "accept", "--verdict", "missing", "--by", "kari", "--store", store).code == 0
    assert twin("export", out, "--store", store).code == 0
    assert exported(out) == SETS
    assert twin("decide", "undo", "--by", "kari", "--store", store).code == 0
    assert twin("export", out, "--store", store).code == 0
    assert exported(out) == []


def test_export_writes_sets_with_their_provenance(twin: Twin, road_store: Path, tmp_path: Path) -> None:
    """XML and JSON say the same and validate; every change names who, which drives, frames and versions."""
    accept_all(twin, road_store)
    answer = twin("export", tmp_path / "a", "--store", road_store, "--json")
    assert answer.code == 0
    assert [Path(name).name for name in answer.json["files"]][-1] == "proveniens.json"
    folder = tmp_path / "a"
    assert exported(folder) == SETS
    sett = from_xml((folder / "endringssett-1.xml").read_bytes())
    assert isinstance(sett, Endringssett)
    assert sett == from_json((folder / "endringssett-1.json").read_bytes())
    assert all(finding.severity == "advarsel" for finding in validate(sett))
    document = json.loads((folder / "proveniens.json").read_bytes())
    assert [change["verdict"] for change in document["changes"]].count("moved") == 1
    for told in document["changes"]:
        assert told["decision"]["by"] == "kari"
        assert [drive["name"] for drive in told["drives"]] == ["trip_trondheim"]
        assert bool(told["frames"]) == (told["verdict"] != "missing")
        assert bool(told["nvdb"]["read"]) == (told["nvdb"]["id"] is not None)
        assert bool(told["nvdb"]["version"]) == (told["nvdb"]["id"] is not None)
        assert all(len(drive["content_sha256"]) == 64 for drive in told["drives"])
        assert all(numbers for cameras in told["frames"].values() for numbers in cameras.values())
        assert set(told["frames"]) <= {drive["drive_id"] for drive in told["drives"]}
        # No geoid model is installed here: no height, and it is said.
        assert ("height" in told) == (told["verdict"] in {"new", "moved"})
        assert "HREF2018B is not installed" in told.get("height", "HREF2018B is not installed")
    assert document["software"].startswith("twin ")
    assert (document["match"]["method"], len(document["match"]["config_sha256"])) == ("adjusted", 64)
    assert document["match"]["settings"]["matching"]["tolerance_m"] == 1.0
    assert twin("export", tmp_path / "b", "--store", road_store).code == 0
    for name in SETS:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_preview_of_open_findings_is_named_so(twin: Twin, store: Path, tmp_path: Path) -> None:
    """`--decision open` shows what accepting would do, in files that cannot be taken for accepted ones."""
    out = tmp_path / "out"
    answer = twin("export", out, "--decision", "open", "--store", store)
    assert answer.code == 0
    assert "cannot be sent" in answer.err
    assert exported(out) == [
        "preview-datafangst-1.geojson",
        "preview-endringssett-1.json",
        "preview-endringssett-1.xml",
        "preview-proveniens.json",
    ]


def test_set_with_errors_is_not_written(twin: Twin, store: Path, tmp_path: Path) -> None:
    """Our own checks stop a set; the other files are written, each error is told, the exit code is 4."""
    assert twin("decide", "accept", "--verdict", "wrong_type", "--by", "kari", "--store", store).code == 0
    with Store.open(store) as opened, opened.transaction() as connection:
        opened.put_fact(connection, "datakatalog", {**snapshot().to_document(), "version": "beta"})
    answer = twin("export", tmp_path / "out", "--store", store)
    assert answer.code == 4
    assert "set 1 is not written: endringssett has the datakatalogversjon 'beta'" in answer.err
    assert exported(tmp_path / "out") == ["proveniens.json"]
    assert (tmp_path / "out" / FILES[0]).exists()


def test_nothing_decided_gives_no_files(store: Path) -> None:
    """A store without accepted findings has nothing to write."""
    assert files_of(made_from(store)) == {}


@pytest.fixture
def road_store(matched_road: Path, tmp_path: Path) -> Path:
    """A copy of the matched store that also has a road network."""
    return Path(shutil.copy(matched_road, tmp_path / "road.db"))
