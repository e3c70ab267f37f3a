"""Each role does what it may, by the commands themselves, and is told in a sentence what it may not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import psycopg
import pytest
import sqlalchemy as sa
from command_line import Twin
from later_versions import with_revisions
from postgres_server import Server

from twin.decisions.log import history
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.copying import copy_store
from twin.store.roles import Role
from twin.store.store import Store

LOGINS = {"rita": Role.READER, "vera": Role.REVIEWER, "inge": Role.INGESTER, "odd": Role.OWNER}
DENIED = "ask who owns the store for the right to do this"


@pytest.fixture
def database(
    postgres: Server, matched_store: Path, twin: Twin, monkeypatch: pytest.MonkeyPatch
) -> Iterator[str]:
    """The name of a database with the sample, its roles made by the command, and a login in each."""
    monkeypatch.delenv("TWIN_USER", raising=False)
    address = postgres.new()
    copy_store(matched_store, address)
    for _ in range(2):  # again changes nothing
        assert twin("store", "init-roles", "--store", address).code == 0
    name = StoreAddress(address).url().database or ""
    postgres.run(*(f"CREATE ROLE {login} LOGIN IN ROLE {role}" for login, role in LOGINS.items()))
    yield name
    postgres.run(*(f"DROP ROLE {login}" for login in LOGINS))


def test_each_role_does_what_it_may(
    twin: Twin, postgres: Server, database: str, trip: Path, nvdb_url: str, tmp_path: Path
) -> None:
    """A reviewer decides and ingests nothing; an ingester keeps the store, and changes no log."""
    as_ = {login: ("--store", postgres.address(database, login)) for login in LOGINS}
    with Store.open(as_["rita"][1], create=False) as store:
        change_id = str(store.rows(sa.select(schema.change.c.change_id).limit(1))[0]["change_id"])

    assert twin("findings", *as_["rita"]).code == 0
    refused = twin("decide", change_id, "accept", *as_["rita"])
    assert (refused.code, DENIED in refused.err) == (4, True)

    assert twin("decide", change_id, "accept", *as_["vera"]).code == 0
    assert twin("decide", "undo", *as_["vera"]).code == 0
    for command in (("match",), ("ingest-drive", trip)):
        refused = twin(*command, *as_["vera"])
        assert (refused.code, refused.err.count(DENIED)) == (4, 1), refused.err

    sync = ("sync-nvdb", "--kommune", "5001", "--api-url", nvdb_url)
    for command in (sync, ("ingest-drive", trip), ("match",), ("export", tmp_path / "out"), ("evidence",)):
        told = twin(*command, *as_["inge"])
        assert told.code == 0, (command, told.err)
    with Store.open(as_["inge"][1], create=False) as store:
        assert [entry.by for entry in history(store.rows, change_id)] == ["vera", "vera"]
    for login in ("vera", "inge"):
        with connected(postgres, database, login) as connection:
            for statement in ("UPDATE twin.decision_log SET \"by\" = 'x'", "DELETE FROM twin.decision_log"):
                with pytest.raises(psycopg.errors.InsufficientPrivilege):
                    connection.execute(statement)


def test_decisions_are_made_in_the_name_of_the_login(
    twin: Twin, postgres: Server, database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither option, environment nor SQL gives a reviewer another name; an owner brings others' along."""
    as_ = {login: ("--store", postgres.address(database, login)) for login in LOGINS}
    with Store.open(as_["rita"][1], create=False) as store:
        change_id = str(store.rows(sa.select(schema.change.c.change_id).limit(1))[0]["change_id"])
    for login in ("vera", "inge"):
        refused = twin("decide", change_id, "accept", "--by", "kari", *as_[login])
        assert (refused.code, f"the login {login} decides in its own name" in refused.err) == (4, True)
    with monkeypatch.context() as patch:
        patch.setenv("TWIN_USER", "kari")
        assert twin("decide", change_id, "accept", *as_["vera"]).code == 4
    assert twin("decide", change_id, "accept", "--by", "vera", *as_["vera"]).code == 0
    assert twin("decide", change_id, "dismiss", "--by", "kari", *as_["odd"]).code == 0
    with connected(postgres, database, "vera") as connection:
        again = "INSERT INTO twin.decision_log ({0}) SELECT {0} FROM twin.decision_log WHERE \"by\" = 'kari'"
        names = ", ".join(f'"{column.name}"' for column in schema.decision_log.columns if column.name != "id")
        with pytest.raises(psycopg.errors.InsufficientPrivilege, match="vera decides in its own name"):
            connection.execute(again.format(names))
    with Store.open(as_["rita"][1], create=False) as store:
        assert [entry.by for entry in history(store.rows, change_id)] == ["vera", "kari"]


def test_layers_are_edited_by_reviewers_alone(postgres: Server, database: str) -> None:
    """Of what a view shows a reviewer sets the answer and nothing else."""
    edit = "UPDATE twin_qgis.changes SET decision = 'defer'"
    for login in ("rita", "inge"):
        with connected(postgres, database, login) as connection:
            assert connection.execute("SELECT count(*) FROM twin_qgis.drives").fetchone() == (1,)
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                connection.execute(edit)
    with connected(postgres, database, "vera") as connection:
        assert connection.execute(edit).rowcount > 0
        assert connection.execute("SELECT DISTINCT author FROM twin_qgis.changes").fetchall() == [("vera",)]
        for other in ("changes SET reason = ''", "drives SET name = ''"):
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                connection.execute(f"UPDATE twin_qgis.{other}")


def test_upgrade_is_the_owners_and_leaves_the_roles_their_rights(
    postgres: Server, database: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A table that a later version adds belongs to the role, and readers read it."""
    with monkeypatch.context() as later:
        with_revisions(
            tmp_path / "migrations",
            later,
            {schema.VERSION + 1: 'op.create_table("later", sa.Column("a", sa.Integer))'},
        )
        with pytest.raises(Exception, match=DENIED):
            Store.open(postgres.address(database, "vera"), create=False)
        Store.open(postgres.address(database, "odd"), create=False).close()
    with connected(postgres, database, "rita") as connection:
        assert connection.execute("SELECT count(*) FROM twin.later").fetchone() == (0,)
        owner = connection.execute("SELECT tableowner FROM pg_tables WHERE tablename = 'later'").fetchone()
        assert owner == (Role.OWNER,)
    with connected(postgres, database, "vera") as connection:
        assert connection.execute("UPDATE twin_qgis.changes SET decision = 'defer'").rowcount > 0


def test_print_says_what_would_be_run(
    twin: Twin, postgres: Server, matched_store: Path, tmp_path: Path
) -> None:
    """Without a store; an administrator runs it by psql. A file has no roles."""
    printed = twin("store", "init-roles", "--print", "--store", tmp_path / "none.db")
    assert printed.code == 0
    assert "GRANT SELECT ON ALL TABLES IN SCHEMA twin, twin_qgis TO twin_reader;" in printed.out
    address = postgres.new()
    postgres.run(printed.out, database=StoreAddress(address).url().database or "")
    refused = twin("store", "init-roles", "--store", matched_store)
    assert refused.code == 2
    assert "is a file" in refused.err


def connected(postgres: Server, database: str, login: str) -> psycopg.Connection:
    """Connect as QGIS does."""
    host = str(StoreAddress(postgres.address(database)).url().query["host"])
    return psycopg.connect(host=host, dbname=database, user=login, autocommit=True)
