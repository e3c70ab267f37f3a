"""What NVDB said on a day: observed where the mirror was there, assumed from dates of validity before."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.mirror import LesV4Source, Source, UberiketSource, sync
from nvdb.replay import ReplayServer, ReplayWorld
from twin.errors import StoreError
from twin.mirror.history import mirror_as_of
from twin.mirror.mirror_tables import StoreMirror
from twin.store import schema
from twin.store.store import Store

Raw = dict[str, Any]
BEGIN = date(2026, 5, 1)


def _point(number: int, **metadata: Any) -> Raw:
    """A Skiltpunkt in V4's form, valid from 2020 and last modified in 2024 unless told otherwise."""
    wkt = f"POINT Z (270000 {7_040_000 + number % 1000} 10)"
    return {
        "id": number,
        "metadata": {
            "type": {"id": 95, "navn": "Skiltpunkt"},
            "versjon": 1,
            "startdato": "2020-01-01",
            "sist_modifisert": "2024-02-03T04:05:06Z",
            **metadata,
        },
        "egenskaper": [
            {"id": 4794, "navn": "Geometri, punkt", "egenskapstype": "Geometri", "verdi": wkt},
        ],
        "lokasjon": {"kommuner": [5001]},
        "geometri": {"wkt": wkt, "srid": 5973, "egengeometri": True},
    }


def _plate(number: int, text: str, **metadata: Any) -> Raw:
    """A Skiltplate whose text tells its states apart."""
    raw = _point(number, **{"type": {"id": 96, "navn": "Skiltplate"}, **metadata})
    return {**raw, "egenskaper": _texts(text)}


def _texts(text: str) -> list[Raw]:
    return [
        {"id": 5530, "navn": "Skiltnummer", "egenskapstype": "Tekstenum", "verdi": "202", "enum_id": 7642},
        {"id": 1910, "navn": "Tekst", "egenskapstype": "Tekst", "verdi": text},
    ]


class Diary:
    """A world, a mirror of it, and a calendar that both live by: changes come at 06, syncs at 08."""

    def __init__(self, store: Store, stack: ExitStack, source: str, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = datetime(BEGIN.year, BEGIN.month, BEGIN.day, 6, tzinfo=UTC)
        self.world = ReplayWorld(clock=lambda: self.now)
        self.store = store
        server = stack.enter_context(ReplayServer(self.world))
        client = stack.enter_context(NvdbClient(server.url, sleep=lambda _s: None))
        made = LesV4Source if source == "les-v4" else UberiketSource
        self._source: Source = made(client, clock=lambda: self.now)
        monkeypatch.setattr("twin.mirror.mirror_tables.utc_now", lambda: f"{self.now:%Y-%m-%dT%H:%M:%SZ}")

    def on(self, day: date) -> None:
        """Turn to the morning of a day."""
        self.now = datetime(day.year, day.month, day.day, 6, tzinfo=UTC)

    def sync(self) -> None:
        """Sync two hours later."""
        self.now += timedelta(hours=2)
        sync(
            self._source,
            StoreMirror(self.store),
            Area(),
            confirm_deletions=True,
            clock=lambda: self.now,
        )

    def texts(self, day: date) -> dict[int, str]:
        """Plates on a day, and their texts."""
        return {plate["nvdb_id"]: plate["text"] for plate in mirror_as_of(self.store, day)[1]}

    def basis(self, day: date) -> dict[int, str]:
        """Plates on a day, and how that is known."""
        return {plate["nvdb_id"]: plate["basis"] for plate in mirror_as_of(self.store, day)[1]}


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Diary]]:
    """``start()`` gives an empty diary at 1 May 2026."""
    with ExitStack() as stack:

        def make(source: str = "les-v4") -> Diary:
            store = stack.enter_context(Store.open(tmp_path / "twin.db"))
            return Diary(store, stack, source, monkeypatch)

        yield make


def _day(number: int) -> date:
    return BEGIN + timedelta(days=number)


def test_history_gives_the_state_that_was_seen_on_the_day(start: Callable[..., Diary]) -> None:
    """A plate that changes on 11 May reads as the old one until 10 May and as the new one from 11 May."""
    diary = start()
    diary.world.create(96, _plate(1, "gammel"))
    diary.sync()
    diary.on(_day(10))
    diary.world.update(1, egenskaper=_texts("ny"))
    diary.sync()
    assert [diary.texts(_day(k)) for k in (0, 9, 10, 30)] == [{1: "gammel"}] * 2 + [{1: "ny"}] * 2
    assert [diary.basis(_day(k))[1] for k in (0, 9, 10, 30)] == ["observed"] * 4


def test_history_dates_a_change_by_nvdb_and_a_deletion_by_our_sync(start: Callable[..., Diary]) -> None:
    """Changed and created on 6 May, synced on 11 May: known from 6 May on; a deletion only from 11 May on."""
    diary = start()
    for number in (1, 2):
        diary.world.create(96, _plate(number, "gammel"))
    diary.sync()
    diary.on(_day(5))
    diary.world.update(1, egenskaper=_texts("ny"))
    diary.world.remove(2)
    diary.world.create(96, _plate(3, "opprettet", sist_modifisert="2026-05-06T06:00:00Z"))
    diary.on(_day(10))
    diary.sync()
    assert diary.texts(_day(4)) == {1: "gammel", 2: "gammel"}
    assert diary.texts(_day(5)) == {1: "ny", 2: "gammel", 3: "opprettet"}
    assert diary.basis(_day(5)) == {1: "unmodified", 2: "observed", 3: "unmodified"}
    assert diary.texts(_day(10)) == {1: "ny", 3: "opprettet"}


def test_history_before_the_mirror_goes_by_gyldighet(start: Callable[..., Diary]) -> None:
    """Before the first sync an object is there from its start date on, and the row says how that is known."""
    diary = start()
    diary.world.create(96, _plate(1, "urørt", startdato="2020-01-01", sist_modifisert="2023-01-01T00:00:00Z"))
    diary.world.create(
        96, _plate(2, "rettet", startdato="2020-01-01", sist_modifisert="2026-04-01T00:00:00Z")
    )
    diary.world.create(96, _plate(3, "nytt", startdato="2025-06-01", sist_modifisert="2026-04-01T00:00:00Z"))
    diary.sync()
    assert diary.basis(date(2019, 12, 31)) == {}
    assert diary.basis(date(2020, 1, 1)) == {1: "gyldighet", 2: "gyldighet"}
    assert diary.basis(date(2025, 5, 31)) == {1: "unmodified", 2: "gyldighet"}
    assert diary.basis(date(2025, 6, 1)) == {1: "unmodified", 2: "gyldighet", 3: "gyldighet"}
    assert diary.basis(date(2026, 4, 1)) == {1: "unmodified", 2: "unmodified", 3: "unmodified"}
    assert diary.basis(BEGIN) == {1: "observed", 2: "observed", 3: "observed"}


def test_history_takes_the_earliest_known_state_before_the_mirror(start: Callable[..., Diary]) -> None:
    """What changed after the first sync is not read back into the time before it."""
    diary = start()
    diary.world.create(96, _plate(1, "gammel", sist_modifisert="2026-04-30T00:00:00Z"))
    diary.sync()
    diary.on(_day(3))
    diary.world.update(1, egenskaper=_texts("ny"))
    diary.sync()
    assert diary.texts(date(2026, 4, 1)) == {1: "gammel"}


def test_history_does_not_believe_a_start_date_against_what_was_seen(start: Callable[..., Diary]) -> None:
    """A plate registered in June with a start date in 2020 was not in NVDB in May, when the mirror stood."""
    diary = start()
    diary.world.create(96, _plate(1, "alltid"))
    diary.sync()
    diary.on(_day(20))
    diary.world.create(96, _plate(2, "etterregistrert", sist_modifisert="2026-05-21T06:00:00Z"))
    diary.sync()
    assert diary.texts(_day(19)) == {1: "alltid"}
    assert set(diary.texts(_day(20))) == {1, 2}


def test_history_knows_the_gap_between_deletion_and_new_creation(start: Callable[..., Diary]) -> None:
    """Seen, gone, seen again: in between it is not there, whatever its dates say."""
    diary = start()
    for number in (1, 2):
        diary.world.create(96, _plate(number, "først"))
    diary.sync()
    diary.on(_day(5))
    diary.world.remove(1)
    diary.sync()
    diary.on(_day(9))
    diary.world.recreate(1, egenskaper=_texts("igjen"))
    diary.sync()
    assert [diary.texts(_day(k)).get(1) for k in (4, 5, 8, 9)] == ["først", None, None, "igjen"]


def test_history_does_not_believe_sist_modifisert_against_what_was_seen(start: Callable[..., Diary]) -> None:
    """A state that claims to be older than another, or a deletion, that we saw counts from its fetch."""
    diary = start()
    diary.world.create(96, _plate(1, "gammel"))
    diary.world.create(96, _plate(2, "først"))
    diary.sync()
    diary.on(_day(5))
    diary.world.remove(2)
    diary.sync()
    diary.on(_day(10))
    diary.world.update(1, egenskaper=_texts("ny"), metadata=_plate(1, "")["metadata"])
    claimed = _plate(2, "", sist_modifisert="2026-05-04T00:00:00Z")["metadata"]
    diary.world.recreate(2, egenskaper=_texts("igjen"), metadata=claimed)
    diary.sync()
    assert diary.texts(_day(4)) == {1: "gammel", 2: "først"}
    assert diary.texts(_day(9)) == {1: "gammel"}
    assert diary.texts(_day(10)) == {1: "ny", 2: "igjen"}


def test_history_ends_a_state_on_its_end_date(start: Callable[..., Diary]) -> None:
    """A plate that NVDB said would end on 20 May is there on 19 May and not on 20 May, also unsynced."""
    diary = start()
    diary.world.create(96, _plate(1, "midlertidig", sluttdato="2026-05-20"))
    diary.sync()
    assert set(diary.texts(_day(18))) == {1}
    assert diary.texts(_day(19)) == {}


def test_history_of_today_is_the_mirror(start: Callable[..., Diary]) -> None:
    """On the day of the last sync both types come back as the visible rows, without their raw objects."""
    diary = start()
    for number in (11, 12, 13):
        diary.world.create(95, _point(number))
    diary.world.create(96, _plate(1, "a"))
    diary.sync()
    for found, tables in zip(mirror_as_of(diary.store, BEGIN), schema.MIRROR.values(), strict=True):
        columns = [column for column in tables.visible.columns if column.name != "raw"]
        want = diary.store.rows(sa.select(*columns).order_by(tables.visible.c.nvdb_id))
        assert found == [{**row, "basis": "observed"} for row in want]


def test_history_of_a_box_holds_what_stood_in_it_on_the_day(start: Callable[..., Diary]) -> None:
    """A plate that moves out of the box is in it before, and one that moves in is in it after."""
    diary = start()
    for number in (10, 20, 90):  # metres north of 7,040,000
        diary.world.create(96, _plate(number, "a"))
    diary.sync()
    diary.on(_day(10))
    for number, north in ((10, 7_040_095), (90, 7_040_015)):
        moved = _plate(number, "a")["geometri"] | {"wkt": f"POINT Z (270000 {north} 10)"}
        diary.world.update(number, geometri=moved)
    diary.sync()
    box = (269_999.0, 7_040_000.0, 270_001.0, 7_040_030.0)

    def inside(day: date) -> list[int]:
        return [plate["nvdb_id"] for plate in mirror_as_of(diary.store, day, within=box)[1]]

    assert inside(_day(9)) == [10, 20]
    assert inside(_day(10)) == [20, 90]


def test_history_begins_with_the_mirror_of_the_present_area(start: Callable[..., Diary]) -> None:
    """Before the day that the mirror of this area began, absence from the mirror proves nothing."""
    diary = start()
    diary.world.create(96, _plate(1, "a"))
    diary.sync()
    diary.on(_day(10))
    diary.world.create(96, _plate(2, "b", sist_modifisert="2026-05-11T06:00:00Z"))
    diary.sync()
    assert set(diary.texts(_day(5))) == {1}
    fact = diary.store.fact("mirror") or {}
    with diary.store.transaction() as connection:
        diary.store.put_fact(connection, "mirror", {**fact, "since": "2026-05-11T08:00:00Z"})
    assert diary.basis(_day(5)) == {1: "observed", 2: "gyldighet"}


def test_history_needs_a_mirror(start: Callable[..., Diary]) -> None:
    """A store that was never synced has nothing to say about any day."""
    with pytest.raises(StoreError, match="no NVDB signs yet"):
        mirror_as_of(start().store, BEGIN)


def _change_something(world: ReplayWorld, chance: random.Random, serial: int, day: date) -> None:
    """Create, change, give a new version, close, remove or bring back one plate."""
    there = [record.id for record in world.select(96, {})]
    gone = sorted(world._removed)
    text = f"tilstand {serial}"
    match chance.choice(["create", "update", "update", "version", "close", "remove", "recreate"]):
        case "update" if there:
            world.update(chance.choice(there), egenskaper=_texts(text))
        case "version" if there:
            world.new_version(chance.choice(there), day.isoformat(), egenskaper=_texts(text))
        case "close" if len(there) > 3:
            world.close(chance.choice(there), day.isoformat())
        case "remove" if len(there) > 3:
            world.remove(chance.choice(there))
        case "recreate" if gone:
            world.recreate(chance.choice(gone), egenskaper=_texts(text))
        case _:
            modified = f"{day.isoformat()}T06:00:00Z"
            world.create(96, _plate(1000 + serial, text, startdato=day.isoformat(), sist_modifisert=modified))


def _truth(world: ReplayWorld) -> dict[int, str]:
    """Plates that the world shows, and their texts."""
    return {
        record.id: next(item["verdi"] for item in record.raw["egenskaper"] if item["id"] == 1910)
        for record in world.select(96, {})
    }


@pytest.mark.parametrize("source", ["les-v4", "uberiket"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_history_agrees_with_a_world_that_changed_at_random(
    start: Callable[..., Diary], source: str, seed: int
) -> None:
    """On days of a sync it is the truth; between them every state that a sync ever brought has its days.

    Between two syncs only two things cannot be known: a state that was replaced before it was fetched, and
    the day of a deletion.
    """
    diary, chance, serial = start(source), random.Random(seed), 0
    for number in range(1, 31):
        diary.world.create(96, _plate(number, f"først {number}"))
    truth: dict[date, dict[int, str]] = {}
    synced: list[date] = []
    for day in map(_day, range(40)):
        diary.on(day)
        for _ in range(chance.choice([0, 1, 1, 2]) if day > BEGIN else 0):
            serial += 1
            _change_something(diary.world, chance, serial, day)
        truth[day] = _truth(diary.world)
        if day == BEGIN or day == _day(39) or chance.random() < 0.3:
            diary.sync()
            synced.append(day)
    assert [diary.texts(day) for day in synced] == [truth[day] for day in synced]
    fetched = {(i, text) for day in synced for i, text in truth[day].items()}
    wrong = 0
    for day, there in truth.items():
        said = set(diary.texts(day).items())
        assert {state for state in there.items() if state in fetched} <= said
        for number, text in said - set(there.items()):
            wrong += 1
            assert (number, there.get(number, "")) not in fetched, f"{number} read {text!r} on {day}"
    # Most of all days' rows are right, or the test would prove little.
    assert wrong < 0.1 * sum(len(there) for there in truth.values())
