"""Roads beside signs, as the store keeps its network."""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator
from typing import Any

import shapely
import sqlalchemy as sa

from twin.store import schema
from twin.store.store import Row, Store

_BLOCK_M, _BLOCKS = 500.0, 10
_WIDTH_M = _BLOCK_M * (_BLOCKS + 1)
_ALONG, _AGAINST = "Trafikk i metreringsretning", "Trafikk mot metreringsretning"


def with_road(store: Store, **known: str) -> None:
    """Give the store a road network of one link: the drive's own track, metered with it; `known` of it."""
    line = store.rows(sa.select(schema.drive.c.line))[0]["line"]
    _put(store, [_link(1, shapely.from_wkb(line), "KV1 S1D1 m0-1000", 1)], **known)


def with_streets(store: Store, west_m: float, south_m: float, **known: str) -> None:
    """Give a town of square blocks its streets, and NVDB's signs there what NVDB says of a sign and its road.

    Every other link is metered the other way. Of the plates most face the traffic on their side, some the
    other, both, the road or nobody says; some are set on a link by name, some have no place, or one of their
    own beside their pole. Some signs are on the centre line alone, and some stand where no drive comes.
    """
    _put(store, _streets(west_m, south_m), **known)
    draw = random.Random(3)
    with store.transaction() as connection:
        view = store.view(connection)
        points = view.rows(sa.select(schema.skiltpunkt).order_by(schema.skiltpunkt.c.nvdb_id))
        for row in points:
            side = _side(row, west_m, south_m)
            loose = {"own_geometry": False, **side["foot"]} if draw.random() < 0.2 else {}
            away_m = _WIDTH_M if draw.random() < 0.1 else 0.0
            place = {"east_m": (row | loose)["east_m"] + away_m, "north_m": (row | loose)["north_m"]}
            _update(connection, schema.skiltpunkt, row["nvdb_id"], loose | place)
            for plate_id in row["plate_ids"]:
                (face,) = draw.choices(*_FACES)
                of_plate = loose | place | {"ansiktsside": side["face"] if face == _RIGHT else face}
                if draw.random() < 0.1:
                    of_plate["stedfesting"] = [{"veglenkesekvensid": side["link"], "relativ_posisjon": 0.3}]
                elif draw.random() < 0.1:
                    of_plate |= draw.choice([{"east_m": None, "north_m": None}, _beside(place, draw)])
                _update(connection, schema.skiltplate, plate_id, of_plate)
        store.touch(connection)


_RIGHT = "as the traffic on its side has to see it"
_FACES = ([_RIGHT, _ALONG, _AGAINST, "Tosidig", "Parallelt mot veg", None], [75, 5, 5, 5, 5, 5])


def _beside(place: dict[str, float], draw: random.Random) -> dict[str, float]:
    return {name: metres + draw.uniform(-30.0, 30.0) for name, metres in place.items()}


def _streets(west_m: float, south_m: float) -> Iterator[Row]:
    for street in range(_BLOCKS + 1):
        for block in range(_BLOCKS):
            for is_north in (True, False):
                number = _number(street, block, is_north=is_north)
                steps = [(street * _BLOCK_M, (block + k) * _BLOCK_M) for k in (0, 1)]
                ends = [(x, y) if is_north else (y, x) for x, y in steps]
                line = shapely.LineString([(west_m + x, south_m + y) for x, y in ends])
                yield _link(number, line, f"KV{number} S1D1 m0-500", 1 if block % 2 else -1)


def _side(row: Row, west_m: float, south_m: float) -> Row:
    """Of a sign: its link, the foot on the centre line, which traffic on its side sees its face."""
    east, north = row["east_m"] - west_m, row["north_m"] - south_m
    streets = [round(one / _BLOCK_M) for one in (east, north)]
    is_north = abs(east - streets[0] * _BLOCK_M) < abs(north - streets[1] * _BLOCK_M)
    street, along, across = (streets[0], north, east) if is_north else (streets[1], east, north)
    block = min(max(int(along // _BLOCK_M), 0), _BLOCKS - 1)
    # The traffic on the right of a street to the north goes north, on that of one to the east west.
    with_line = (across > street * _BLOCK_M) is is_north
    foot = {"east_m": west_m + street * _BLOCK_M} if is_north else {"north_m": south_m + street * _BLOCK_M}
    face = _ALONG if with_line is bool(block % 2) else _AGAINST
    return {"link": _number(street, block, is_north=is_north), "foot": foot, "face": face}


def _number(street: int, block: int, *, is_north: bool) -> int:
    return 1 + block + _BLOCKS * street + 1000 * is_north


def _link(number: int, line: shapely.LineString, kortform: str, retning: int) -> Row:
    return {
        "veglenkesekvensid": number,
        "veglenkenummer": 1,
        "segmentnummer": 1,
        "startposisjon": 0.0,
        "startdato": "2000-01-01",
        "sluttposisjon": 1.0,
        "konnektering": False,
        "detaljert": False,
        "type_veg": "enkelBilveg",
        "detaljniva": "Vegtrase",
        "vegkategori": "K",
        "trafikantgruppe": "K",
        "kortform": kortform,
        "retning": retning,
        "geometri": shapely.to_wkb(shapely.force_3d(line, 0.0)),
    }


def _update(connection: sa.Connection, table: sa.Table, nvdb_id: int, values: Row) -> None:
    connection.execute(sa.update(table).where(table.c.nvdb_id == nvdb_id).values(**values))


def _put(store: Store, links: Iterable[Row], **known: Any) -> None:
    with store.transaction() as connection:
        connection.execute(sa.insert(schema.veglenke), list(links))
        store.put_fact(connection, "vegnett", {"rejected": [], **known})
