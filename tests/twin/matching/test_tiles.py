"""A match of everything in parts is that in one piece, bit for bit, wherever the edges of tiles cut."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import sqlalchemy as sa
from fleet import fill, let_next_come
from municipality_world import ORIGIN
from one_road import with_streets

from twin.matching import match, tiles
from twin.matching.kept import arrays_of
from twin.matching.match_store import MatchReport
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.store import Store

METHOD = "adjusted"
OF_ROADS = ("along", "faces")
AT_A_CORNER_M = (-2200.0, 2600.0)
"""So far moved the world has a corner of four tiles in its middle."""


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four drives of 16 km past 400 signs, about a corner where four tiles meet."""
    path = tmp_path_factory.mktemp("filled") / "twin.db"
    fill(path, 4, 400, AT_A_CORNER_M)
    return path


@pytest.fixture(params=["no network", "streets"])
def both(request: pytest.FixtureRequest, filled: Path, tmp_path: Path) -> Path:
    """The same without and with a road network."""
    path = Path(shutil.copy(filled, tmp_path / "a.db"))
    if request.param == "streets":
        with Store.open(path) as store:
            with_streets(store, *(ORIGIN + AT_A_CORNER_M).tolist(), fetched_at="2026-06-01")
    return path


def all_that_is_left(store: Store) -> list[object]:
    """What a match says, and what it leaves to the next one."""
    part = schema.kept_part
    tables = [
        sa.select(schema.change).order_by(schema.change.c.change_id),
        sa.select(schema.pole_key).order_by(schema.pole_key.c.member),
        sa.select(schema.known_mark).order_by(schema.known_mark.c.id),
        sa.select(part).where(part.c.kind.not_in(OF_ROADS)).order_by(part.c.kind, part.c.key),
    ]
    return [store.rows(asked) for asked in tables]


def roads_beside_signs(store: Store) -> dict[tuple[str, str, bytes], bytes]:
    """What a match leaves of the roads beside signs: of each sign two numbers."""
    found = {}
    for row in store.rows(sa.select(schema.kept_part).where(schema.kept_part.c.kind.in_(OF_ROADS))):
        arrays = arrays_of(row["arrays"])
        for name, numbers in zip(arrays["name"].tolist(), arrays["numbers"], strict=True):
            found[row["kind"], row["key"], name] = numbers.tobytes()
    return found


def assert_same_is_left(store: Store, whole: Store) -> None:
    """By both; a tile knows the roads of its signs where no drive came, too."""
    assert all_that_is_left(store) == all_that_is_left(whole)
    assert roads_beside_signs(whole).items() <= roads_beside_signs(store).items()


def work_off(store: Store) -> int:
    """Work out the parts of the next match, the last one first; return how many there were."""
    n = 0
    while parts := tiles.parts_to_do(store, least=1):
        for name in reversed(parts.names):
            worked = tiles.work_out(store.address, parts.method, parts.plan, name)
            with store.transaction() as connection:
                tiles.stage(connection, parts.plan, worked)
            n += 1
    return n


def at_once(store: Store, said: list[str] | None = None) -> MatchReport:
    """Match, and leave out when the last match was."""
    report = match(store, progress=None if said is None else said.append)
    return replace(report, news=report.news and replace(report.news, since=""))


def in_parts(store: Store, monkeypatch: pytest.MonkeyPatch) -> MatchReport:
    """Match from parts alone."""
    with monkeypatch.context() as patch:
        patch.setattr("twin.matching.match_store.everything", None)
        return at_once(store)


def test_match_in_parts_is_that_in_one_piece(
    both: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first one, the one after a drive of what that touches, and another one of everything."""
    path, other = both, Path(shutil.copy(both, tmp_path / "b.db"))
    with Store.open(path) as store, Store.open(other) as whole:
        assert work_off(store) > 4
        assert in_parts(store, monkeypatch) == at_once(whole)
        assert_same_is_left(store, whole)
        for each in (path, other):
            let_next_come(each)
        assert tiles.parts_to_do(store, least=1) is None
        said: list[str] = []
        assert at_once(store, said) == at_once(whole)
        assert "matching everything" not in " ".join(said)
        assert_same_is_left(store, whole)
        for one in (store, whole):
            with one.transaction() as connection:
                # As if another version had written it: names of poles, and no more, are known.
                connection.execute(sa.delete(schema.kept_part))
                connection.execute(sa.update(schema.estimate).values(north_m=schema.estimate.c.north_m + 0.3))
                one.touch(connection)
        assert work_off(store) > 4
        assert in_parts(store, monkeypatch) == at_once(whole)
        assert_same_is_left(store, whole)
        assert match(store, anew=True).kept_agree is True


def test_parts_of_an_earlier_store_are_worth_nothing(filled: Path, tmp_path: Path) -> None:
    """A drive that comes meanwhile: the part gives nothing, and others are to be worked out."""
    path = Path(shutil.copy(filled, tmp_path / "a.db"))
    with Store.open(path) as store:
        before = tiles.parts_to_do(store, least=1)
        assert before is not None
        let_next_come(path)
        assert tiles.work_out(StoreAddress.of(path), METHOD, before.plan, before.names[0]) == {}
        after = tiles.parts_to_do(store, least=1)
    assert after is not None
    assert after.plan != before.plan


def test_tile_that_may_hang_on_what_lies_beyond_leaves_all_to_one_match(
    filled: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Estimates so uncertain that pairs of them reach over any margin: one match looks at everything."""
    path, other = Path(shutil.copy(filled, tmp_path / "a.db")), tmp_path / "b.db"
    with Store.open(path) as store:
        with store.transaction() as connection:
            worse = {name: schema.estimate.c[name] + 400.0 for name in ("cov_ee_m2", "cov_nn_m2")}
            connection.execute(sa.update(schema.estimate).values(**worse))
        store.close()
        shutil.copy(path, other)
        work_off(store)
        with pytest.raises(TypeError):
            in_parts(store, monkeypatch)
        with Store.open(other) as whole:
            assert at_once(store) == at_once(whole)
            assert all_that_is_left(store) == all_that_is_left(whole)
