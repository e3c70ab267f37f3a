"""A store in PostgreSQL: what it says when something is wrong, and what only PostGIS can do."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
import sqlalchemy as sa
from command_line import Twin
from findings import finding
from postgres_server import Server

from twin.errors import ConfigError, StoreError
from twin.matching.save import save_changes
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.store import Store

SECRET = "S3cret-of-mine"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            f"postgresql://ola:{SECRET}@127.0.0.1:1/signs?connect_timeout=5",
            "@127.0.0.1:1/signs could not be used",
        ),
        (f"postgresql+psycopg2://ola:{SECRET}@db/signs", "uses psycopg: write postgresql://USER@HOST"),
        (f"postgresql://ola:{SECRET}@db:port/signs", "is no address: write postgresql://USER@HOST"),
        (f"postgres://ola:{SECRET}@127.0.0.1/signs?speed=high", "could not be used"),
    ],
)
def test_address_that_leads_nowhere_is_one_sentence_without_the_password(
    twin: Twin, text: str, told: str
) -> None:
    """On the way through the command line, where an error shows all that it knows."""
    answer = twin("status", "--store", text)
    assert answer.code == (2 if "write postgresql" in told else 4)
    assert told in answer.err
    assert SECRET not in answer.err + answer.out
    assert SECRET not in str(StoreAddress(text)) + repr(StoreAddress(text))


def test_database_without_a_store_says_what_to_run(postgres: Server) -> None:
    """A command that only reads makes nothing there."""
    address = postgres.new("postgis")
    assert not Store.exists(address)
    for _ in range(2):
        with pytest.raises(StoreError, match=r"no store in postgresql://.*run `twin sync-nvdb`"):
            Store.open(address, create=False)
    Store.open(address).close()
    assert Store.exists(address)
    Store.open(address, create=False).close()


def test_database_of_others_is_left_alone(postgres: Server) -> None:
    """Tables of other schemas do not matter; a schema of our name with other tables is refused."""
    address = postgres.new("postgis")
    database = StoreAddress(address).url().database or ""
    postgres.run("CREATE TABLE meta (other int)", database=database)
    Store.open(address).close()
    taken = postgres.new("postgis")
    database = StoreAddress(taken).url().database or ""
    postgres.run("CREATE SCHEMA twin", "CREATE TABLE twin.other (a int)", database=database)
    with pytest.raises(StoreError, match="holds tables and is not a twin store"):
        Store.open(taken)


def test_newer_store_is_refused(postgres: Server) -> None:
    """What a newer twin wrote is not guessed at."""
    address = postgres.new()
    with Store.open(address) as opened, opened.transaction() as connection:
        is_version = schema.meta.c.key == "schema_version"
        connection.execute(sa.update(schema.meta).where(is_version).values(value=str(schema.VERSION + 1)))
    with pytest.raises(StoreError, match="newer twin"):
        Store.open(address)


def test_user_without_rights_reads_and_is_told_why_nothing_is_written(postgres: Server) -> None:
    """A reader's commands work; who may read nothing gets one sentence."""
    address = postgres.new()
    database = StoreAddress(address).url().database or ""
    postgres.run(
        *("CREATE ROLE guest LOGIN", "CREATE ROLE stranger LOGIN"),
        *("GRANT USAGE ON SCHEMA twin TO guest", "GRANT SELECT ON ALL TABLES IN SCHEMA twin TO guest"),
        database=database,
    )
    with Store.open(postgres.address(database, "guest"), create=False) as opened:
        assert opened.count(schema.change) == 0
        assert opened.read_only is not None
        with pytest.raises(StoreError, match="ask who owns the store"):
            save_changes(opened, [finding("a")], {}, {"method": "m"})
    with pytest.raises(StoreError, match=r"permission denied.*ask who owns the store"):
        Store.open(postgres.address(database, "stranger"), create=False)


def test_second_writer_waits_its_turn_and_sees_what_the_first_has_left(postgres: Server) -> None:
    """Eight at once: every revision counts, as nobody works with the state of before he waited."""
    address = postgres.new()

    def count() -> None:
        with Store.open(address) as store:
            for _ in range(5):
                with store.transaction() as connection:
                    store.touch(connection)

    threads = [threading.Thread(target=count) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with Store.open(address) as store:
        assert store.revision() == 40


def test_positions_are_geometries_that_an_index_finds(postgres: Server) -> None:
    """The point of a finding follows its coordinates, in EPSG:25833, and a search by place uses the index."""
    with Store.open(postgres.new()) as store:
        save_changes(store, [finding("a", east_m=270000.0, north_m=7040000.5)], {}, {"method": "m"})
        at = store.rows(sa.select(sa.text("ST_AsEWKT(geom) AS at")).select_from(schema.change))
        assert at == [{"at": "SRID=25833;POINT(270000 7040000.5)"}]
        near = "SELECT change_id FROM change WHERE ST_DWithin(geom, ST_SetSRID(ST_MakePoint(0, 0), 25833), 5)"
        with store.transaction() as connection:
            connection.exec_driver_sql("SET LOCAL enable_seqscan = off")
            plan = connection.exec_driver_sql(f"EXPLAIN {near}").scalars().all()
        assert any("ix_change_geom" in line for line in plan)


def test_pictures_are_in_the_folder_that_the_address_names(postgres: Server, tmp_path: Path) -> None:
    """Without one, the sentence says how to name it."""
    bare = postgres.new().partition("&pictures=")[0]
    with Store.open(f"{bare}&pictures={tmp_path}") as store:
        assert store.pictures == tmp_path
    with Store.open(bare) as store, pytest.raises(ConfigError, match=r"add \?pictures=FOLDER"):
        _ = store.pictures
