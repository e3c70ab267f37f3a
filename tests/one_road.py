"""A road beside the signs of the sample, as the store keeps its network."""

from __future__ import annotations

import shapely
import sqlalchemy as sa

from twin.store import schema
from twin.store.store import Store


def with_road(store: Store, **known: str) -> None:
    """Give the store a road network of one link: the drive's own track, metered with it; `known` of it."""
    line = store.rows(sa.select(schema.drive.c.line))[0]["line"]
    link = {
        "veglenkesekvensid": 1,
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
        "kortform": "KV1 S1D1 m0-1000",
        "retning": 1,
        "geometri": shapely.to_wkb(shapely.force_3d(shapely.from_wkb(line), 0.0)),
    }
    with store.transaction() as connection:
        connection.execute(sa.insert(schema.veglenke), [link])
        store.put_fact(connection, "vegnett", {"rejected": [], **known})
