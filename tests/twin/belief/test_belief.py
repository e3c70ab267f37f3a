"""Beliefs of a store: what one drive says, what drives that disagree say, and what nobody passed."""

from __future__ import annotations

import datetime as dt
from collections.abc import Collection
from pathlib import Path
from typing import Any

import pyogrio
import pytest
import sqlalchemy as sa
from command_line import Twin

from twin.belief import Believed, believe, roads_to_drive
from twin.errors import ConfigError, RefusedError
from twin.matching import match
from twin.store import schema
from twin.store.poses import blob_from_poses, poses_from_blob
from twin.store.store import Row, Store

METHOD = "adjusted"
DAY_NS = 86_400_000_000_000
OF_DRIVES = (schema.drive, schema.drive_method, schema.estimate, schema.sighting)


def again(store: Store, days: int, *, without: Collection[str] = (), complete: bool = True) -> None:
    """The same drive some days later, which does not see some objects."""
    first = store.rows(sa.select(schema.drive.c.drive_id).order_by(schema.drive.c.started_ns))[0]["drive_id"]
    name = f"drive{days}"
    with store.transaction() as connection:
        for table in OF_DRIVES:
            rows = store.view(connection).rows(sa.select(table).where(table.c.drive_id == first))
            kept = [_later(row, first, name, days) for row in rows if row.get("object") not in without]
            changed = {"annotations_complete": complete} if table is schema.drive else {}
            connection.execute(sa.insert(table), [{**row, **changed} for row in kept])
        store.touch(connection)


def _later(row: Row, first: str, name: str, days: int) -> dict[str, Any]:
    own = {key: row[key].replace(first, name) for key in ("drive_id", "estimate_id", "name") if key in row}
    own |= {key: value + days * DAY_NS for key, value in row.items() if key.endswith("_ns")}
    if "poses" in row:
        poses = poses_from_blob(row["poses"])
        parts = {key: getattr(poses, key) for key in poses.__slots__}
        own["poses"] = blob_from_poses(type(poses)(**{**parts, "epoch_ns": poses.epoch_ns + days * DAY_NS}))
    return {**row, **own}


@pytest.fixture
def june(opened: Store) -> Store:
    """The sample after its drive of June, NVDB synced that day."""
    with opened.transaction() as connection:
        mirror = opened.view(connection).fact("mirror") or {}
        opened.put_fact(connection, "mirror", {**mirror, "synced_at": "2026-06-10T12:00:00Z"})
    return opened


def places(store: Store, **options: Any) -> dict[str, Believed]:
    """What is believed of each place, by its id."""
    return {one.place_id: one for one in believe(store, **options).places}


def object_at(store: Store, place: Believed) -> str:
    """The annotated object that stands at a place."""
    t = schema.estimate.c
    near = sa.func.abs(t.east_m - place.east_m) + sa.func.abs(t.north_m - place.north_m)
    asked = sa.select(t.object).where(t.method == METHOD).order_by(near)
    return str(store.rows(asked)[0]["object"])


def test_after_one_drive_the_belief_says_what_the_verdict_says(june: Store) -> None:
    """What was seen stands, what is missing is gone with its confidence, the rest is NVDB's word alone."""
    confidence = {
        f"{row['nvdb_type']}:{row['nvdb_id']}": row["confidence"]
        for row in june.rows(sa.select(schema.change).where(schema.change.c.verdict == "missing"))
    }
    found = places(june)
    verdicts = {one.verdict for one in found.values()}
    assert {"unchanged", "moved", "wrong_type", "new", "missing", None} <= verdicts
    for one in found.values():
        match one.verdict:
            case "missing":
                assert one.p_stands == pytest.approx(1 - confidence[one.place_id], abs=1e-3)
                assert (one.state, one.last_seen, one.n_missed) == ("gone", None, 1)
            case None:
                assert (one.state, one.p_stands, one.last_passed) == ("not_passed", 0.98, None)
            case _:
                assert one.p_stands > 0.99
                assert (one.state, one.n_seen, one.n_missed) == ("stands", 1, 0)


def test_drives_that_disagree_over_time(june: Store) -> None:
    """Stood in June, gone in September by two drives, back in December: belief and verdict go along."""
    sign = next(one for one in places(june).values() if one.verdict == "unchanged")
    gone = object_at(june, sign)
    # Of what it did not see, a drive that was not completely annotated says nothing.
    again(june, 60, without=[gone], complete=False)
    match(june, method=METHOD)
    still = places(june)[sign.place_id]
    assert (still.state, still.n_missed, still.verdict) == ("stands", 0, "unchanged")
    for days in (90, 97):
        again(june, days, without=[gone])
    match(june, method=METHOD)
    september = places(june)
    assert september[sign.place_id].p_stands < 0.05
    assert (september[sign.place_id].state, september[sign.place_id].verdict) == ("gone", "missing")
    assert str(september[sign.place_id].last_seen).startswith("2026-06")
    assert (september[sign.place_id].n_seen, september[sign.place_id].n_missed) == (1, 2)
    others = [one for one in september.values() if one.verdict == "unchanged"]
    assert len(others) > 5
    assert all(one.p_stands > 0.99 for one in others)
    again(june, 180)
    match(june, method=METHOD)
    december = places(june)[sign.place_id]
    assert (december.state, december.verdict, december.n_seen) == ("stands", "unchanged", 2)


def test_a_belief_fades_with_time_and_the_same_store_gives_the_same(june: Store) -> None:
    """Years later what was seen is less sure, never asked of a moment before the newest drive."""
    now, later = places(june), places(june, at=dt.datetime(2031, 6, 10, tzinfo=dt.UTC))
    seen = [key for key, one in now.items() if one.n_seen]
    assert seen
    assert all(0.85 < later[key].p_stands < now[key].p_stands for key in seen)
    assert now == places(june)
    with pytest.raises(ConfigError, match="from then on"):
        places(june, at=dt.datetime(2020, 1, 1, tzinfo=dt.UTC))
    again(june, 5)
    with pytest.raises(RefusedError, match="twin match"):
        believe(june)


def believed(road: str, p_stands: float, kommune: str = "5001", state: str = "unsure") -> Believed:
    """One place on a road."""
    return Believed(
        place_id=road,
        nvdb_type=95,
        nvdb_id=1,
        skiltnummer="202",
        p_stands=p_stands,
        unsure_bits=1.0 if p_stands == 0.5 else 0.1,
        state=state,
        last_seen=None,
        last_passed=None,
        n_seen=0,
        n_missed=0,
        verdict=None,
        road=road,
        kommune=kommune,
        east_m=0.0,
        north_m=0.0,
        longitude_deg=0.0,
        latitude_deg=0.0,
        p_visible=p_stands,
    )


def test_roads_are_ranked_by_what_a_drive_settles_a_kilometre() -> None:
    """A sign of even chances is settled by a perfect drive: one bit; on 2 km half a bit a kilometre."""
    roads = roads_to_drive(
        [
            believed("FV1 S1D1 m100", 0.5),
            believed("FV1 S1D1 m2100", 1.0, state="stands"),
            believed("FV2 S1D1 m40-60", 0.5, kommune="5001,5031"),
            believed("FV1 S1D1 m300", 0.0, kommune="5031", state="not_passed"),
            believed("", 0.5),
        ],
        p_seen=1.0,
        p_false=0.0,
    )
    assert [(one.road, one.kommune, one.km, one.settled_bits_per_km) for one in roads] == [
        ("FV2 S1D1", "5001", 0.5, 2.0),
        ("FV1 S1D1", "5001", 2.0, 0.5),
        ("FV1 S1D1", "5031", 0.5, 0.0),
    ]
    assert (roads[1].n_places, roads[1].n_unsure, roads[2].n_not_passed) == (2, 1, 1)


def test_the_command_lists_filters_and_writes(twin: Twin, store: Path, tmp_path: Path) -> None:
    """The least sure first; files hold what was asked for; a day before the newest drive is refused."""
    options = ["--store", store]
    every = twin("belief", "--json", *options).json
    bits = [one["unsure_bits"] for one in every["places"]]
    assert bits == sorted(bits, reverse=True)
    assert sum(every["states"].values()) == every["total"] == len(bits)
    gone = twin("belief", "--state", "gone", "--max-probability", "0.3", "--json", *options).json
    assert {one["verdict"] for one in gone["places"]} == {"missing"}
    assert twin("belief", "--kommune", "301", "--json", *options).json["total"] == 0
    road = twin("belief", "--road", "kv 2210", "--json", *options).json
    assert {one["road"].split()[0] for one in road["places"]} == {"KV2210"}
    paths = [tmp_path / f"roads{ending}" for ending in (".csv", ".geojson", ".gpkg")]
    files = [f"--{path.suffix[1:]}={path}" for path in paths]
    ranked = twin("belief", "--next", *files, "--json", *options).json["roads"]
    assert [one["road"] for one in ranked] != []
    assert paths[0].read_text().splitlines()[1].startswith(ranked[0]["road"])
    for path, layer in zip(paths[1:], (None, "roads"), strict=True):
        assert list(pyogrio.read_dataframe(path, layer=layer)["road"]) == [one["road"] for one in ranked]
    assert len(pyogrio.read_dataframe(paths[2], layer="signs")) == every["total"]
    assert "KV2210" in twin("belief", "--next", "--lang", "nb", *options).out
    assert twin("belief", "--at", "2020-01-01", *options).code == 2
