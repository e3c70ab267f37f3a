"""The live layers: a decision made by SQL is the one that ``twin decide`` would have made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import psycopg
import pytest
from command_line import Twin
from findings import finding
from postgres_server import Server

from twin.decisions import decide
from twin.decisions.log import Entry, history
from twin.errors import StoreError
from twin.matching.save import save_changes
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.copying import copy_store
from twin.store.kinds import Verdict
from twin.store.store import Store


@pytest.fixture
def address(postgres: Server) -> str:
    """A store with three findings; `b` has no covariance, `c` stands for road works."""
    made = postgres.new()
    terms = {"pole": "d:1", "seen": {"first": "2026-06-01T08:00:00Z", "last": "2026-06-01T08:00:00Z"}}
    found = [
        finding("a", covariance_m2=(0.1234567891, -1e-7, 0.3), terms=terms, drive_ids=("d", "e")),
        finding(
            "b", verdict=Verdict.MOVED, nvdb_type=95, nvdb_id=7, distance_m=1.23456, distance_sigma_m=0.3
        ),
        finding("c", skiltnummer_seen=("110",), terms=terms),
    ]
    with Store.open(made) as store:
        save_changes(store, found, {}, {"method": "adjusted", "revision": 0})
    return made


@pytest.fixture
def login(postgres: Server, address: str) -> Iterator[psycopg.Connection]:
    """A connection of QGIS's kind to it, as ola, who is nobody's owner."""
    postgres.run(
        "DO $$ BEGIN IF NOT EXISTS (SELECT FROM pg_roles WHERE rolname = 'ola') THEN CREATE ROLE ola LOGIN; "
        "END IF; END $$",
        *("GRANT SELECT ON ALL TABLES IN SCHEMA twin TO ola", "GRANT INSERT ON twin.decision_log TO ola"),
        "GRANT USAGE ON SCHEMA twin, twin_qgis TO ola",
        "GRANT USAGE ON ALL SEQUENCES IN SCHEMA twin TO ola",
        "GRANT SELECT, UPDATE ON ALL TABLES IN SCHEMA twin_qgis TO ola",
        database=StoreAddress(address).url().database or "",
    )
    url = StoreAddress(address).url()
    with psycopg.connect(
        host=str(url.query["host"]), dbname=url.database, user="ola", autocommit=True
    ) as connection:
        yield connection


def entries(address: str, change_id: str) -> list[Entry]:
    """The history of one finding."""
    with Store.open(address, create=False) as store:
        return history(store.rows, change_id)


@pytest.mark.parametrize("change_id", ["a", "b"])
def test_edit_is_the_entry_that_decide_writes(
    login: psycopg.Connection, address: str, change_id: str
) -> None:
    """Every column, and the evidence to the last digit; the author is the login, whatever the file says."""
    edit = "UPDATE twin_qgis.changes SET decision = 'accept', comment = ' seen ' WHERE change_id = %s"
    login.execute(edit, (change_id,))
    (edited,) = entries(address, change_id)
    with Store.open(address, create=False) as store:
        decide(store, [change_id], "accept", by="ola", reason="seen, and measured")
    decided = entries(address, change_id)[-1]
    assert edited == replace(decided, reason="seen", id=edited.id, batch=edited.batch, at=edited.at)
    assert edited.at[:10] == decided.at[:10]
    assert len(edited.at) == len(decided.at)


def test_edits_that_are_saved_together_are_taken_back_together(
    twin: Twin, login: psycopg.Connection, address: str
) -> None:
    """One batch a transaction, from either view; what says nothing new adds nothing."""
    with login.transaction():
        login.execute("UPDATE twin_qgis.changes SET decision = 'dismiss' WHERE change_id = 'a'")
        login.execute(
            "UPDATE twin_qgis.changes_wgs84 SET decision = 'defer', comment = 'look' WHERE change_id = 'b'"
        )
    login.execute("UPDATE twin_qgis.changes SET decision = 'dismiss', comment = NULL WHERE change_id = 'a'")
    login.execute("UPDATE twin_qgis.changes SET decision = 'open' WHERE change_id = 'c'")
    seen = login.execute(
        "SELECT change_id, decision, comment, author FROM twin_qgis.changes ORDER BY 1"
    ).fetchall()
    assert seen == [("a", "dismiss", "", "ola"), ("b", "defer", "look", "ola"), ("c", "open", "", "")]
    assert [entry.batch for one in "abc" for entry in entries(address, one)] == [1, 1]
    login.execute("UPDATE twin_qgis.changes SET comment = 'again' WHERE change_id = 'b'")
    assert [(e.batch, e.decision, e.reason) for e in entries(address, "b")][1:] == [(2, "defer", "again")]
    assert twin("decide", "undo", "2", "--store", address).code == 0
    assert {entries(address, one)[-1].decision for one in "ab"} == {"open"}
    # Nobody was named: it is the login of the store.
    assert entries(address, "a")[-1].by == "postgres"


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        ("SET decision = 'perhaps' WHERE change_id = 'a'", "choose one of open, accept, dismiss, defer"),
        ("SET decision = NULL WHERE change_id = 'a'", "choose one of"),
        ("SET author = 'kari' WHERE change_id = 'a'", "only decision and comment can be edited"),
        ("SET geom = ST_Translate(geom, 1, 0), decision = 'accept'", "only decision and comment"),
        ("SET decision = 'accept' WHERE change_id = 'c'", "road works: decide it by twin decide"),
    ],
)
def test_what_the_view_cannot_decide_is_refused(
    login: psycopg.Connection, address: str, edit: str, told: str
) -> None:
    """In one sentence, and nothing is written."""
    with Store.open(address, create=False) as store:
        decide(store, ["c"], "dismiss", by="kari", temporary=True)
    with pytest.raises(psycopg.errors.RaiseException, match=told):
        login.execute(f"UPDATE twin_qgis.changes {edit}")
    assert [entry.by for one in "abc" for entry in entries(address, one)] == ["kari"]


def test_stale_findings_are_not_decided(login: psycopg.Connection, address: str) -> None:
    """As `twin decide` refuses them; and one whose snapshot is older than the log is no writer."""
    login.execute("SET default_transaction_isolation = 'repeatable read'")
    edit = "UPDATE twin_qgis.changes SET decision = 'accept' WHERE change_id = 'a'"
    with pytest.raises(psycopg.errors.RaiseException, match="READ COMMITTED"):
        login.execute(edit)
    login.execute("RESET default_transaction_isolation")
    with Store.open(address, create=False) as store, store.transaction() as connection:
        store.touch(connection)
    with pytest.raises(psycopg.errors.RaiseException, match="twin match has to run first"):
        login.execute(edit)
    assert entries(address, "a") == []


def test_layers_show_the_sample(postgres: Server, matched_store: Path) -> None:
    """Findings, estimates of the matched method, signs and drives, as QGIS lists them."""
    made = postgres.new()
    copy_store(matched_store, made)
    url = StoreAddress(made).url()
    with psycopg.connect(host=str(url.query["host"]), dbname=url.database, user="postgres") as connection:
        listed = connection.execute(
            "SELECT f_table_name, type, srid FROM geometry_columns WHERE f_table_schema = 'twin_qgis' "
            "ORDER BY 1"
        ).fetchall()
        n = {
            name: connection.execute(f"SELECT count(geom), count(*) FROM twin_qgis.{name}").fetchone()
            for name, *_ in listed
        }
        degrees = connection.execute(
            "SELECT min(ST_X(geom)), max(ST_Y(geom)) FROM twin_qgis.changes_wgs84"
        ).fetchone()
        methods = connection.execute("SELECT DISTINCT method FROM twin_qgis.estimates").fetchall()
        sigma = connection.execute("SELECT bool_and(sigma_major_m >= sigma_minor_m) FROM twin_qgis.estimates")
        assert sigma.fetchone() == (True,)
    assert listed == [
        ("changes", "POINT", 25833),
        ("changes_wgs84", "POINT", 4326),
        ("drives", "LINESTRING", 25833),
        ("estimates", "POINT", 25833),
        ("nvdb_signs", "POINT", 25833),
    ]
    with Store.open(made, create=False) as store:
        assert n["changes"] == n["changes_wgs84"] == (store.count(schema.change),) * 2
        assert n["drives"] == (1, 1)
        assert n["nvdb_signs"] is not None
        assert n["nvdb_signs"][1] == store.count(schema.skiltpunkt) + store.count(schema.skiltplate)
    assert methods == [("adjusted",)]
    assert degrees is not None
    assert 10 < degrees[0] < 11
    assert 63 < degrees[1] < 64


def test_store_of_before_gets_the_layers_and_what_others_built_on_them_is_kept(
    postgres: Server, address: str
) -> None:
    """An upgrade says what is in its way, and does nothing by halves."""
    database = StoreAddress(address).url().database or ""
    older = "UPDATE twin.meta SET value = '16' WHERE key = 'schema_version'"
    postgres.run("DROP SCHEMA twin_qgis CASCADE", older, database=database)
    Store.open(address, create=False).close()
    mine = "CREATE VIEW public.mine AS SELECT * FROM twin_qgis.changes"
    postgres.run(mine, older, database=database)
    with pytest.raises(StoreError, match="rests on the layers of twin_qgis is in the way"):
        Store.open(address, create=False)
    postgres.run("DROP VIEW public.mine", database=database)
    Store.open(address, create=False).close()
    postgres.run(mine, database=database)
