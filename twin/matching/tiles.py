"""A match of everything in parts that any processes which reach the store work out: drives first, then tiles.

A tile is a square of 8 km, at whose edges rows of the store end. What is found in it is worked out from the
tile and a margin about it (:mod:`twin.matching.tile`). What came of a part waits in the store, under
:data:`STAGED`, for the match that puts all of them together: it is that of everything, bit for bit.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import IntArray
from twin.matching.asked import Asked, choose_method, sites_of
from twin.matching.cells import NOWHERE, coarser, widened
from twin.matching.config import MatchConfig
from twin.matching.drives import beside_nvdb, drives_of, known_drives, warnings_of
from twin.matching.found import Found, gathered_poles, since_last, where_drives_were
from twin.matching.in_view import VIEWS
from twin.matching.kept import Kept, arrays_of, digest, packed_arrays
from twin.matching.left import PER_BLOCK, PER_SQUARE, KnownDrive, State
from twin.matching.poles.seen_in import clicks_of
from twin.matching.reading import estimates_of, rows_of_drives
from twin.matching.roads import PLACELESS, joined
from twin.matching.sites import mirror_near
from twin.matching.tile import WorkedTile, worked_tile
from twin.store import schema
from twin.store.address import StoreAddress
from twin.store.records import Finding
from twin.store.store import Snapshot, Store

STAGED = "staged"
"""Kind of the parts that wait for their match."""
DRIVES_A_PART = 20
_DRIVES, _DRIVE, _TILE = "drives", "drive", "tile"

Worked = Mapping[str, bytes]
"""What was worked out of a part, by the names under which it waits."""


@dataclass(frozen=True, slots=True)
class Parts:
    """What can be worked out now, side by side.

    Attributes
    ----------
    method : str
        Whose estimates are matched.
    plan : str
        Of which state of the store they are: with another one nothing of them is worth anything.
    names : tuple of str
    """

    method: str
    plan: str
    names: tuple[str, ...]


def parts_to_do(store: Store, *, least: int) -> Parts | None:
    """Say which parts of the next match can be worked out now.

    Parameters
    ----------
    store : Store
    least : int
        With fewer drives a match is not taken apart.

    Returns
    -------
    Parts or None
        None where only the match itself is left: all parts are there, it is one of what was touched alone, or
        a small one.
    """
    method = choose_method(store, None)
    with store.snapshot() as view:
        asked = _asked(store, view, method)
        plan = _Plan(asked)
        is_large = len(plan.drive_ids) >= least and view.fact("mirror") is not None
        if not is_large or since_last(asked, Kept(view)) is not None:
            return None
        left = [name for name in plan.of_drives if name not in plan.there]
        if not left:
            left = [name for name in plan.tiles() if name not in plan.there]
    return Parts(method, plan.name, tuple(left)) if left else None


def work_out(address: StoreAddress, method: str, plan: str, name: str) -> Worked:
    """Work out a part, in any process.

    Returns
    -------
    Worked
        Nothing where the store has changed since the plan was made.
    """
    with Store.open(address, create=False) as store, store.snapshot() as view:
        asked = _asked(store, view, method)
        now = _Plan(asked)
        if now.name != plan:
            return {}
        kind, _, number = name.partition(" ")
        if kind == _DRIVES:
            start = int(number) * DRIVES_A_PART
            return _worked_drives(asked, name, now.drive_ids[start : start + DRIVES_A_PART])
        kept, squares = Kept(view), now.squares()
        tile = worked_tile(asked, int(number), squares, lambda ids: now.take_drives(kept, ids), kept)
        return {name: tile.packed()}


def stage(connection: sa.Connection, plan: str, worked: Worked) -> None:
    """Let what was worked out of a part wait for its match, inside the caller's transaction."""
    t = schema.kept_part
    for name, packed in worked.items():
        row = {"kind": STAGED, "key": f"{plan} {name}", "arrays": packed}
        connection.execute(sa.delete(t).where(t.c.kind == STAGED, t.c.key == row["key"]))
        connection.execute(sa.insert(t), [row])


def put_together(asked: Asked, kept: Kept) -> Found | None:
    """Put the findings of all tiles together.

    Returns
    -------
    Found or None
        None where a part is not there or was not sure, or where two of them contradict one another.
    """
    plan = _Plan(asked)
    if not plan.there.issuperset(plan.of_drives) or not plan.there.issuperset(plan.tiles()):
        return None
    tiles = [WorkedTile.of(plan.read(name)) for name in plan.tiles()]
    keys = [key for tile in tiles for key in set(tile.keys.values())]
    rows = [row for tile in tiles for row in tile.findings]
    is_twice = len(set(keys)) < len(keys) or len({row["change_id"] for row in rows}) < len(rows)
    if is_twice or not all(tile.is_sure for tile in tiles):
        return None
    known = plan.take_drives(kept, plan.drive_ids)
    drives = drives_of(asked.view, asked.method, asked.config, kept, None, known)
    _join_views(kept, tiles)
    for tile in tiles:
        kept.take(tile.parts)
    if placeless := [tile.parts[PLACELESS] for tile in tiles if PLACELESS in tile.parts]:
        kept.take({PLACELESS: joined(placeless)})
    squares = {drive.drive_id: known[drive.drive_id].squares for drive in drives}
    totals = np.stack([tile.totals for tile in tiles]).sum(axis=0)
    revision = asked.view.revision()
    state = State(asked.rests_on(), revision, totals, asked.codes(), squares, warnings_of(drives))
    state.put(kept)
    marks = {member: mark for tile in tiles for member, mark in tile.marks.items()}
    return Found(
        revision=revision,
        findings=sorted(map(Finding.from_row, rows), key=lambda one: one.change_id),
        gone=None,
        keys={member: key for tile in tiles for member, key in tile.keys.items()},
        members_gone=frozenset(),
        marks={member: marks[member] for member in sorted(marks, key=_by_drive)},
        drives=drives,
        known=known,
        state=state,
        kept=kept,
        map_aided="",
        has_network=asked.has_network,
    )


class _Plan:
    """The parts of a match of everything, as one state of the store has them.

    Attributes
    ----------
    name : str
        Digest of all that the parts rest on, as far as it can change.
    drive_ids : list of str
    of_drives : list of str
        Names of the parts of drives.
    there : set of str
        Names of all parts that wait.
    """

    def __init__(self, asked: Asked) -> None:
        self._view = view = asked.view
        said = [asked.rests_on(), view.revision(), view.fact("last_match")]
        self.name = digest(json.dumps(said, sort_keys=True).encode())
        d, m = schema.drive.c, schema.drive_method.c
        ids = sa.select(d.drive_id).join(
            schema.drive_method, (m.drive_id == d.drive_id) & (m.method == asked.method)
        )
        self.drive_ids = sorted(row["drive_id"] for row in view.rows(ids))
        self.of_drives = [f"{_DRIVES} {k}" for k in range(-(-len(self.drive_ids) // DRIVES_A_PART))]
        t = schema.kept_part.c
        waiting = sa.select(t.key).where(t.kind == STAGED, t.key.startswith(f"{self.name} "))
        self.there = {row["key"].partition(" ")[2] for row in view.rows(waiting)}

    def read(self, name: str) -> bytes:
        """What was worked out of a part that waits."""
        t = schema.kept_part.c
        asked = sa.select(t.arrays).where(t.kind == STAGED, t.key == f"{self.name} {name}")
        return bytes(self._view.rows(asked)[0]["arrays"])

    def squares(self) -> dict[str, IntArray]:
        """By which each drive is found."""
        found: dict[str, IntArray] = {}
        for name in self.of_drives:
            found |= arrays_of(self.read(name))
        return found

    def tiles(self) -> list[str]:
        """Names of the tiles that drives come near."""
        squares = widened(np.concatenate([NOWHERE, *self.squares().values()]), 1)
        tiles = np.unique(coarser(squares, PER_BLOCK // PER_SQUARE))
        return [f"{_TILE} {number}" for number in tiles.tolist()]

    def take_drives(self, kept: Kept, drive_ids: Iterable[str]) -> dict[str, KnownDrive]:
        """Take what was worked out of drives, and give what is known of them."""
        t = schema.kept_part.c
        keys = {f"{self.name} {_DRIVE} {drive_id}" for drive_id in drive_ids}
        asked = sa.select(t.key, t.arrays).where(t.kind == STAGED)
        for row in rows_of_drives(self._view, asked, t.key, keys):
            drive_id = row["key"].split(" ", 2)[2]
            parts = arrays_of(bytes(row["arrays"]))
            kept.take({(kind, drive_id): array.tobytes() for kind, array in parts.items()})
        return {one: known for one in drive_ids if (known := KnownDrive.of(kept, one)) is not None}


def _asked(store: Store, view: Snapshot, method: str) -> Asked:
    return Asked(store, view, method, MatchConfig(), lambda _text: None)


def _worked_drives(asked: Asked, name: str, drive_ids: Sequence[str]) -> Worked:
    """Where drives drove, by what their clocks are off, and what the next match has to know of them."""
    view, method, config = asked.view, asked.method, asked.config
    kept = Kept(view)
    drives = drives_of(view, method, config, kept, drive_ids)
    estimates = estimates_of(view, method, drive_ids)
    once, _, directions = gathered_poles(asked, estimates, drives, {})
    rows = mirror_near(view, where_drives_were(drives, once), config)
    drives = beside_nvdb(drives, sites_of(asked, rows, kept), once, kept)
    known = known_drives(drives, estimates, clicks_of(view, method, drive_ids), directions, kept)
    for drive in drives:
        drive.watcher.leave()
        known[drive.drive_id].put(kept, drive.drive_id)
    parts: dict[str, dict[str, bytes]] = {}
    for (kind, drive_id), packed in kept.used().items():
        if drive_id in known:
            parts.setdefault(drive_id, {})[kind] = packed
    worked = {
        f"{_DRIVE} {one}": packed_arrays({kind: np.frombuffer(p, np.uint8) for kind, p in of_drive.items()})
        for one, of_drive in parts.items()
    }
    return worked | {name: packed_arrays({one: drive.squares for one, drive in known.items()})}


def _join_views(kept: Kept, tiles: Sequence[WorkedTile]) -> None:
    """Put together what each drive had in view in all tiles."""
    of_drive: dict[str, list[Mapping[str, np.ndarray]]] = {}
    for tile in tiles:
        for drive_id, views in tile.views.items():
            of_drive.setdefault(drive_id, []).append(views)
    for drive_id, parts in of_drive.items():
        joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        order = np.argsort(joined["place"])
        kept.put(
            VIEWS,
            drive_id,
            {**(kept.get(VIEWS, drive_id) or {}), **{name: one[order] for name, one in joined.items()}},
        )


def _by_drive(member: str) -> list[str]:
    return member.split(":", 1)
