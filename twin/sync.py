"""NVDB's signs of an area → the store's mirror, wholly or not at all."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects.sqlite import insert

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.errors import AreaError
from nvdb.mirror import SyncProgress, SyncReport, sync
from nvdb.skilt import Skilt, Skiltplate, Skiltpunkt
from twin import schema
from twin.errors import RefusedError
from twin.store import Store, store_errors, utc_now

_TABLE = {95: schema.skiltpunkt, 96: schema.skiltplate}
_NAME = {95: "Skiltpunkt", 96: "Skiltplate"}


@dataclass(frozen=True, slots=True)
class SyncResult:
    """What a sync brought.

    Attributes
    ----------
    area, source : str
        In words; the API's address.
    skiltpunkt, skiltplate : int
        Objects in the mirror now.
    without_own_geometry : int
        Of both: only placed on the road's centre line.
    n_problems : int
        Objects and values that could not be used.
    problems : tuple of str
        The first of them, one sentence each.
    """

    area: str
    source: str
    synced_at: str
    skiltpunkt: int
    skiltplate: int
    without_own_geometry: int
    n_problems: int
    problems: tuple[str, ...]


def area_from_options(kommune: str | None, bbox: str | None, everything: bool) -> Area:
    """Read the three ways to name an area; exactly one of them must be given.

    Raises
    ------
    AreaError
        None or more than one was given, or it cannot be read.
    """
    given = [value for value in (kommune, bbox, everything or None) if value]
    if len(given) != 1:
        raise AreaError(
            "Say which signs: one of --kommune 5001, --bbox minE,minN,maxE,maxN (UTM33) or --all."
        )
    if kommune:
        return Area.from_kommuner_text(kommune)
    return Area.from_bbox_text(bbox) if bbox else Area()


def sync_nvdb(
    store: Store,
    area: Area,
    *,
    api_url: str,
    contact: str | None = None,
    replace: bool = False,
    progress: Callable[[str, int, int | None], None] | None = None,
) -> SyncResult:
    """Mirror Skiltpunkt and Skiltplate of an area. Until the last page is in, the old mirror stays.

    Parameters
    ----------
    store : Store
    area : Area
    api_url : str
        Base address of API Les V4.
    contact : str, optional
        Sent as ``X-Kontaktperson``.
    replace : bool
        Whether a mirror of another area may be replaced.
    progress : callable, optional
        Called with what is being fetched, how many have come and how many are expected (or None).

    Raises
    ------
    NvdbError
        The API did not answer as it should; the store is unchanged.
    RefusedError
        The store mirrors another area.
    StoreError
        The store could not be written.
    """
    _check_area(store, area, replace)

    def tell(now: SyncProgress) -> None:
        if progress is not None:
            progress(_NAME[now.type_id], now.received, now.expected)

    mirror = StoreMirror(store)
    with NvdbClient(api_url=api_url, contact=contact) as client:
        report = sync(client, mirror, area, progress=tell)
    return _result(report, mirror.synced_at)


def _check_area(store: Store, area: Area, replace: bool) -> None:
    known = store.fact("mirror")
    if known is not None and known["area"] != area.text() and not replace:
        raise RefusedError(
            f"The store {store.path} mirrors {known['area']}, not {area.text()}: name another --store, "
            "or let --replace throw the old mirror away."
        )


def _result(report: SyncReport, synced_at: str) -> SyncResult:
    saved = {kind.type_id: kind.saved for kind in report.types}
    return SyncResult(
        area=report.area.text(),
        source=report.source,
        synced_at=synced_at,
        skiltpunkt=saved.get(95, 0),
        skiltplate=saved.get(96, 0),
        without_own_geometry=sum(kind.without_own_geometry for kind in report.types),
        n_problems=sum(kind.n_problems for kind in report.types),
        problems=tuple(problem for kind in report.types for problem in kind.problems),
    )


class StoreMirror:
    """The store as :class:`nvdb.mirror.MirrorStore`: one transaction from ``begin`` to ``finish``."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._connection: sa.Connection | None = None
        self._transaction: sa.RootTransaction | None = None
        self.synced_at = ""

    def begin(self, area: Area, source: str) -> None:  # noqa: ARG002  # what is kept of them comes in `finish`
        """Start the transaction and empty the mirror inside it: readers see the old one until `finish`."""
        self.synced_at = utc_now()
        with store_errors(self._store.path):
            self._connection = self._store.connect()
            self._transaction = self._connection.begin()
            for table in _TABLE.values():
                self._connection.execute(sa.delete(table))

    def cursor(self, type_id: int) -> None:  # noqa: ARG002
        """Every sync starts at the beginning: none is resumed half-way."""
        return

    def save_page(self, type_id: int, objects: Sequence[Skiltpunkt | Skiltplate], cursor: str | None) -> None:  # noqa: ARG002
        """Add one page; an object that comes again replaces itself."""
        if not objects:
            return
        rows = [self._row(skilt) for skilt in objects]
        statement = insert(_TABLE[type_id])
        changed = {column.name: statement.excluded[column.name] for column in _TABLE[type_id].columns}
        with store_errors(self._store.path):
            self._open().execute(
                statement.on_conflict_do_update(index_elements=["nvdb_id"], set_=changed), rows
            )

    def finish(self, report: SyncReport) -> None:
        """Keep the whole sync."""
        result = _result(report, self.synced_at)
        fact = {**asdict(result), "problems": list(result.problems)}
        with store_errors(self._store.path):
            self._store.put_fact(self._open(), "mirror", fact)
            if self._transaction is not None:
                self._transaction.commit()
        self._close()

    def abort(self) -> None:
        """Keep the old mirror."""
        if self._transaction is not None and self._transaction.is_active:
            self._transaction.rollback()
        self._close()

    def _open(self) -> sa.Connection:
        if self._connection is None:
            msg = "save_page and finish come after begin"
            raise RuntimeError(msg)
        return self._connection

    def _close(self) -> None:
        if self._connection is not None:
            self._connection.close()
        self._connection = self._transaction = None

    def _row(self, skilt: Skiltpunkt | Skiltplate) -> dict[str, Any]:
        own = _plate_columns(skilt) if isinstance(skilt, Skiltplate) else {"plate_ids": list(skilt.plate_ids)}
        return {**_shared_columns(skilt), **own, "synced_at": self.synced_at}


def _shared_columns(skilt: Skilt) -> dict[str, Any]:
    position = skilt.position
    raw = json.dumps(skilt.raw, ensure_ascii=False, separators=(",", ":")).encode()
    return {
        "nvdb_id": skilt.nvdb_id,
        "version": skilt.version,
        "start_date": skilt.start_date,
        "end_date": skilt.end_date,
        "last_modified": skilt.last_modified,
        "east_m": position.east_m if position else None,
        "north_m": position.north_m if position else None,
        "height_m": position.height_m if position else None,
        "own_geometry": skilt.own_geometry,
        "accuracy_cm": skilt.accuracy_cm,
        "capture_method": skilt.capture_method,
        "road_reference": skilt.road_reference,
        "kommuner": list(skilt.kommuner),
        "stedfesting": [asdict(place) for place in skilt.stedfesting],
        "problems": list(skilt.problems),
        "raw": zlib.compress(raw),
    }


def _plate_columns(plate: Skiltplate) -> dict[str, Any]:
    return {
        "point_id": plate.point_id,
        "skiltnummer": plate.skiltnummer,
        "skiltnummer_text": plate.skiltnummer_text,
        "skiltnummer_enum_id": plate.enum_id,
        "ansiktsside": plate.ansiktsside,
        "text": plate.text,
        "plasseringskode": plate.plasseringskode,
    }
