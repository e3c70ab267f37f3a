"""Drives as matching needs them: where they drove, what they had in view, and whether they are trusted."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray, IntArray
from geoloc.rig.rig import Rig, rig_from_document, without_template_masks
from geoloc.trajectory.trajectory import Poses
from twin.matching.absence import Passage, last_seen_by
from twin.matching.cells import NOWHERE, Grid, cells_about, cells_of
from twin.matching.config import MatchConfig
from twin.matching.in_view import VIEWS, Asked, Counts, Places, Watcher
from twin.matching.kept import Arrays, Kept, digest
from twin.matching.left import KnownDrive, squares_of_drive
from twin.matching.poles.ahead import NEAR_M, SURELY_M, Ahead, Signs, ahead_of_nvdb
from twin.matching.poles.many_drives import Driven, headings_at
from twin.matching.poles.poles import ObservedPole
from twin.matching.poles.seen_in import bits_of
from twin.matching.reading import rows_of_drives
from twin.matching.sites import Site
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.records import Corrections, Estimate
from twin.store.store import Row, Snapshot
from twin.words import sentence
from twin.words.reasons import (
    DriveAhead,
    DriveBehind,
    DriveDoesNotFit,
    DriveDoubted,
    Misfit,
    misfit_from_json,
)


@dataclass(frozen=True, slots=True)
class Drive:
    """What matching needs of a drive.

    ``misfits``: in which ways it does not fit itself. ``is_complete``: whether it was declared
    completely annotated. ``absence_gap``: why a sign that it passed and did not see may stand all the same:
    an annotated object without a place, for one, may be that very sign.
    """

    drive_id: str
    name: str
    started_ns: int
    content_sha256: str
    misfits: tuple[Misfit, ...]
    is_complete: bool
    absence_gap: str
    driven: Driven
    cameras: tuple[str, ...]
    watcher: Watcher
    shift: Ahead | None = None
    """Of all its signs against NVDB's."""

    @property
    def is_evidence(self) -> bool:
        """Whether a sign that it passed and did not see is gone."""
        return self.is_complete and not self.absence_gap and self.doubt is None

    @property
    def doubt(self) -> DriveDoubted | None:
        """Why its positions are not trusted; None where they are."""
        if self.misfits or self.shift is None:
            return DriveDoesNotFit(self.name, self.misfits) if self.misfits else None
        kind = DriveAhead if self.shift.late_s > 0 else DriveBehind
        return kind(self.name, abs(self.shift.along_m), abs(self.shift.late_s))

    def warnings(self) -> Iterator[str]:
        """What to know of its findings."""
        if self.doubt is not None:
            told = sentence(self.doubt)
            yield f"{told} Until then its findings are for review, and it shows no sign to be missing."
        elif self.is_complete and self.absence_gap:
            yield f"The drive {self.name} cannot show that a sign is missing: {self.absence_gap}."

    def passage(self, counts: Counts) -> Passage:
        """What it had in view, and what that says."""
        return Passage(self.drive_id, self.started_ns, self.is_evidence, counts)


def drives_of(
    view: Snapshot,
    method: str,
    config: MatchConfig,
    kept: Kept,
    only: Collection[str] | None = None,
    known: Mapping[str, KnownDrive] | None = None,
) -> list[Drive]:
    """Drives ingested by the method, in time order; only these can have seen or missed a sign.

    Parameters
    ----------
    only : collection of str, optional
        Those of these ids.
    known : mapping of drive id to KnownDrive, optional
        What the last match knows of drives that nobody touched since.
    """
    d, m = schema.drive, schema.drive_method
    statement = sa.select(
        *(d.c[name] for name in _LIGHT), m.c.n_unplaced, m.c.corrections, m.c.misfits, m.c.absence_gap
    ).join(m, (m.c.drive_id == d.c.drive_id) & (m.c.method == method))
    rows = sorted(
        rows_of_drives(view, statement, d.c.drive_id, only), key=lambda r: (r["started_ns"], r["drive_id"])
    )
    return [_drive(view, row, config, kept, (known or {}).get(row["drive_id"])) for row in rows]


_LIGHT = ("drive_id", "name", "started_ns", "content_sha256", "cameras", "annotations_complete")


def _drive(view: Snapshot, row: Row, config: MatchConfig, kept: Kept, known: KnownDrive | None) -> Drive:
    drive_id, name = row["drive_id"], row["name"]

    def poses() -> Poses:
        return poses_from_blob(_blob(view, drive_id, "poses"))

    def rig() -> Rig:
        return _rig(_blob(view, drive_id, "rig"), name)

    if known is None:
        packed = _blob(view, drive_id, "rig")
        recorded, car = digest(packed, _blob(view, drive_id, "poses")), hashlib.sha256(packed).hexdigest()
    else:
        recorded, car = known.recorded, known.car

    def heading_deg(epoch_ns: IntArray) -> FloatArray:
        found = None if known is None else known.headings(epoch_ns)
        return headings_at(read_poses(), epoch_ns) if found is None else found

    unplaced = f"{row['n_unplaced']} annotated objects have no position" if row["n_unplaced"] else ""
    read_poses, cameras = cache(poses), tuple(row["cameras"])
    watcher = Watcher(drive_id, cache(rig), read_poses, recorded.encode(), cameras, config, kept)
    return Drive(
        drive_id=drive_id,
        started_ns=row["started_ns"],
        content_sha256=row["content_sha256"],
        name=name,
        misfits=tuple(map(misfit_from_json, row["misfits"])),
        is_complete=bool(row["annotations_complete"]),
        absence_gap=row["absence_gap"] or unplaced,
        driven=Driven(
            drive_id,
            read_poses,
            heading_deg,
            Corrections.from_json(row["corrections"]),
            car,
            recorded,
            has_poses=bool(watcher.coarse.size),
        ),
        cameras=cameras,
        watcher=watcher,
        shift=None if known is None else known.ahead,
    )


def _blob(view: Snapshot, drive_id: str, name: str) -> bytes:
    """Read at once what is large, and of most drives never asked for."""
    asked = sa.select(schema.drive.c[name]).where(schema.drive.c.drive_id == drive_id)
    return bytes(view.rows(asked)[0][name])


def _rig(packed: bytes, name: str) -> Rig:
    return without_template_masks(rig_from_document(json.loads(zlib.decompress(packed)), source=name))[0]


def beside_nvdb(
    drives: Sequence[Drive],
    sites: Sequence[Site],
    estimates: Sequence[Estimate],
    kept: Kept,
    only: Collection[str] | None = None,
) -> list[Drive]:
    """Find out of each drive that fits itself whether one shift brings all its signs to NVDB's.

    Parameters
    ----------
    only : collection of str, optional
        Ids of drives to look at; of these all estimates, and all sites about, have to be there.
    """
    landmarks, mine = _Landmarks(sites), {drive.drive_id: list[Estimate]() for drive in drives}
    for one in estimates:
        mine[one.drive_id].append(one)
    return [
        drive
        if drive.misfits or (only is not None and drive.drive_id not in only)
        else replace(drive, shift=landmarks.shift_of(mine[drive.drive_id], drive, kept))
        for drive in drives
    ]


def cells_if_shifted(drive: Drive, estimates: Sequence[Estimate], sites: Sequence[Site]) -> IntArray:
    """Cells beyond a drive's signs whose sites can tell by what its clock is off; none where it fits.

    Parameters
    ----------
    estimates : sequence of Estimate
        Of the drive, one a pole.
    sites : sequence of Site
        All in the cells of these, at least.
    """
    signs = Signs.of(estimates, drive.driven.read_poses())
    if drive.misfits or signs.fit(sites):
        return NOWHERE
    return cells_about(signs.if_shifted(), NEAR_M)


class _Landmarks:
    """Sites by which the clock of a drive's camera is held against NVDB."""

    def __init__(self, sites: Sequence[Site]) -> None:
        self._sites = [site for site in sites if site.own_geometry and site.codes]
        place = [(site.east_m, site.north_m) for site in self._sites]
        self._grid = Grid(np.array(place).reshape(-1, 2))
        self._all = [repr((*at, site.codes)).encode() for at, site in zip(place, self._sites, strict=True)]

    def shift_of(self, estimates: Sequence[Estimate], drive: Drive, kept: Kept) -> Ahead | None:
        """Return what `ahead_of_nvdb` finds; what it rests on are the sites in some cells."""
        said = [(e.codes, e.last_ns, e.east_m, e.north_m, e.covariance_m2) for e in estimates]
        rests_on = digest(drive.watcher.content, repr(said).encode())
        known = kept.get(_KIND, drive.drive_id)
        if known is None or known["rests_on"].item() != rests_on or not self._are_alike(known):
            signs = Signs.of(estimates, drive.driven.read_poses())
            cells = cells_about(signs.place, SURELY_M)
            found = None
            if not signs.fit(self._inside(cells)):
                cells = cells_about(signs.if_shifted(), NEAR_M)
                found = ahead_of_nvdb(signs, self._inside(cells))
            known = {
                "rests_on": np.array(rests_on),
                "cells": cells,
                "beside": np.array(self._digest(cells)),
                "shift": np.array(found or (), dtype=np.float64),
            }
            kept.put(_KIND, drive.drive_id, known)
        return Ahead(*known["shift"].tolist()) if known["shift"].size else None

    def _inside(self, cells: IntArray) -> list[Site]:
        return [self._sites[j] for j in self._grid.inside(cells).tolist()]

    def _digest(self, cells: IntArray) -> str:
        return digest(*(self._all[j] for j in self._grid.inside(cells).tolist()))

    def _are_alike(self, known: Arrays) -> bool:
        return bool(known["beside"].item() == self._digest(known["cells"]))


_KIND = "clock"


def clock_cells(kept: Kept, drive_id: str) -> IntArray:
    """Cells whose signs told the last match of a drive's clock; none where it was not looked at."""
    known = kept.get(_KIND, drive_id)
    return NOWHERE if known is None else np.asarray(known["cells"])


def forget(kept: Kept, drive_id: str) -> None:
    """Forget what is kept of a drive that is gone."""
    for kind in (_KIND, VIEWS):
        kept.drop(kind, drive_id)
    KnownDrive.drop(kept, drive_id)


def past_poles(drives: Sequence[Drive], poles: Sequence[ObservedPole]) -> list[Passage]:
    """What drives had in view of poles, as far as that can show that one was taken down."""
    asked = Asked(Places.of_poles(poles))
    last_seen = last_seen_by(poles, [drive.drive_id for drive in drives])
    since = ((last_seen < number) & drive.is_evidence for number, drive in enumerate(drives))
    return [
        drive.passage(drive.watcher.past(asked, wanted)) for drive, wanted in zip(drives, since, strict=True)
    ]


def past_sites(
    drives: Sequence[Drive], sites: Sequence[Site], about: IntArray | None = None
) -> list[Passage]:
    """What drives had in view of sites; the last question: what they were asked is kept.

    Parameters
    ----------
    about : int64 (n,), optional
        The cells of all poles and sites that were asked for; what is known of others stays.
    """
    asked = Asked(Places.of_sites(sites))
    passages = [drive.passage(drive.watcher.past(asked)) for drive in drives]
    for drive in drives:
        drive.watcher.keep(about)
    return passages


def known_drives(
    drives: Sequence[Drive],
    estimates: Sequence[Estimate],
    clicks: Mapping[str, Mapping[str, str]],
    directions: Mapping[str, frozenset[float]],
    kept: Kept,
) -> dict[str, KnownDrive]:
    """What the next match has to know of drives of which all estimates are there.

    How a drive was ingested (terrain, error budget, installed grids) is known by what came of it: the hash of
    its estimates.
    """
    mine: dict[str, list[Estimate]] = {drive.drive_id: [] for drive in drives}
    for estimate in estimates:
        if estimate.drive_id in mine:
            mine[estimate.drive_id].append(estimate)
    found = {}
    for drive in drives:
        digests, of_drive = hashlib.sha256(), mine[drive.drive_id]
        for estimate in sorted(of_drive, key=lambda e: e.estimate_id):
            row = estimate.to_row()
            digests.update(json.dumps([row[name] for name in _HASHED], sort_keys=True).encode())
        said = clicks.get(drive.drive_id, {})
        place_m = np.array([(one.east_m, one.north_m) for one in of_drive]).reshape(-1, 2)
        clicked = {one.object: said.get(one.object, "") for one in of_drive}
        members = [f"{drive.drive_id}:{name}" for name in clicked]
        seen_ns = np.unique(np.array([one.last_ns for one in of_drive], dtype=np.int64))
        has_heading = drive.driven.has_poses and seen_ns.size > 0
        concern = [drive.watcher.cells, cells_of(place_m), clock_cells(kept, drive.drive_id)]
        found[drive.drive_id] = KnownDrive(
            recorded=drive.driven.recorded,
            car=drive.driven.car,
            touched=drive.watcher.cells,
            place_m=place_m,
            clicks=clicked,
            ahead=drive.shift,
            estimates_sha256=digests.hexdigest(),
            squares=squares_of_drive(np.concatenate(concern)),
            seen_ns=seen_ns if has_heading else NOWHERE,
            heading_deg=drive.driven.heading_deg(seen_ns) if has_heading else np.zeros(0),
            directions=np.array([bits_of(directions.get(one, ())) for one in members], dtype=np.int64),
        )
    return found


def cells_passed(drives: Sequence[Drive]) -> IntArray:
    """Cells that any of the drives came past, each once."""
    return np.unique(np.concatenate([NOWHERE, *(drive.watcher.cells for drive in drives)]))


def warnings_of(drives: Sequence[Drive]) -> dict[str, tuple[int, list[str]]]:
    """When drives began and what is to be known of their findings, where there is something."""
    told = {drive.drive_id: (drive.started_ns, list(drive.warnings())) for drive in drives}
    return {drive_id: said for drive_id, said in told.items() if said[1]}


_HASHED = (
    "object",
    "east_m",
    "north_m",
    "cov_ee_m2",
    "cov_en_m2",
    "cov_nn_m2",
    "skiltnummer",
    "text",
    "cameras",
)
