"""Drives as matching needs them: where they drove, what they had in view, and whether they are trusted."""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import sqlalchemy as sa

from geoloc.rig.rig import Rig, rig_from_document, without_template_masks
from twin.matching.absence import Passage, last_seen_by
from twin.matching.config import MatchConfig
from twin.matching.in_view import Asked, Counts, Grid, Places, Watcher, cells_about
from twin.matching.kept import Kept, digest
from twin.matching.poles.ahead import NEAR_M, Ahead, ahead_of_nvdb, places_if_shifted
from twin.matching.poles.many_drives import Driven
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Site
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.records import Corrections, Estimate
from twin.store.store import Snapshot
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
    ahead: DriveAhead | DriveBehind | None = None
    """Of all its signs against NVDB's."""

    @property
    def is_evidence(self) -> bool:
        """Whether a sign that it passed and did not see is gone."""
        return self.is_complete and not self.absence_gap and self.doubt is None

    @property
    def doubt(self) -> DriveDoubted | None:
        """Why its positions are not trusted; None where they are."""
        return DriveDoesNotFit(self.name, self.misfits) if self.misfits else self.ahead

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


def drives_of(view: Snapshot, method: str, config: MatchConfig, kept: Kept) -> list[Drive]:
    """Drives ingested by the method, in time order; only these can have seen or missed a sign."""
    d, m = schema.drive, schema.drive_method
    statement = (
        sa.select(d, m.c.n_unplaced, m.c.corrections, m.c.misfits, m.c.absence_gap)
        .join(m, (m.c.drive_id == d.c.drive_id) & (m.c.method == method))
        .order_by(d.c.started_ns, d.c.drive_id)
    )
    drives = []
    for row in view.rows(statement):
        unplaced = f"{row['n_unplaced']} annotated objects have no position" if row["n_unplaced"] else ""
        poses = cache(partial(poses_from_blob, row["poses"]))
        rig, cameras = cache(partial(_rig, row["rig"], row["name"])), tuple(row["cameras"])
        recorded = digest(row["rig"], row["poses"])
        watcher = Watcher(rig, poses, recorded.encode(), cameras, config, kept)
        drives.append(
            Drive(
                drive_id=row["drive_id"],
                started_ns=row["started_ns"],
                content_sha256=row["content_sha256"],
                name=row["name"],
                misfits=tuple(map(misfit_from_json, row["misfits"])),
                is_complete=bool(row["annotations_complete"]),
                absence_gap=row["absence_gap"] or unplaced,
                driven=Driven(
                    row["drive_id"],
                    poses,
                    Corrections.from_json(row["corrections"]),
                    hashlib.sha256(row["rig"]).hexdigest(),
                    recorded,
                    has_poses=bool(watcher.coarse.size),
                ),
                cameras=cameras,
                watcher=watcher,
            )
        )
    return drives


def _rig(packed: bytes, name: str) -> Rig:
    return without_template_masks(rig_from_document(json.loads(zlib.decompress(packed)), source=name))[0]


def beside_nvdb(
    drives: Sequence[Drive], sites: Sequence[Site], estimates: Sequence[Estimate], kept: Kept
) -> list[Drive]:
    """Find out of each drive that fits itself whether one shift brings all its signs to NVDB's."""
    landmarks, mine = _Landmarks(sites), {drive.drive_id: list[Estimate]() for drive in drives}
    for one in estimates:
        mine[one.drive_id].append(one)
    return [
        drive if drive.misfits else _beside(drive, landmarks, mine[drive.drive_id], kept) for drive in drives
    ]


def _beside(drive: Drive, landmarks: _Landmarks, estimates: Sequence[Estimate], kept: Kept) -> Drive:
    ahead = landmarks.shift_of(estimates, drive, kept)
    if ahead is None:
        return drive
    kind = DriveAhead if ahead.late_s > 0 else DriveBehind
    return replace(drive, ahead=kind(drive.name, abs(ahead.along_m), abs(ahead.late_s)))


class _Landmarks:
    """Sites by which the clock of a drive's camera is held against NVDB."""

    def __init__(self, sites: Sequence[Site]) -> None:
        self._sites = [site for site in sites if site.own_geometry and site.codes]
        place = [(site.east_m, site.north_m) for site in self._sites]
        self._grid = Grid(np.array(place).reshape(-1, 2))
        self._all = [repr((*at, site.codes)).encode() for at, site in zip(place, self._sites, strict=True)]

    def shift_of(self, estimates: Sequence[Estimate], drive: Drive, kept: Kept) -> Ahead | None:
        """Return what `ahead_of_nvdb` finds; what it rests on are the sites that a shift can reach."""
        said = [(e.codes, e.last_ns, e.east_m, e.north_m, e.covariance_m2) for e in estimates]
        key = digest(drive.watcher.content, repr(said).encode())
        known = kept.get(_KIND, key)
        if known is None:
            reached = places_if_shifted(estimates, drive.driven.read_poses())
            cells = cells_about(reached, NEAR_M)
        else:
            cells = known["cells"]
        near = self._grid.inside(cells).tolist()
        beside = digest(*(self._all[j] for j in near))
        if known is None or known["beside"].item() != beside:
            found = ahead_of_nvdb(estimates, drive.driven.read_poses(), [self._sites[j] for j in near])
            shift = np.array(found or (), dtype=np.float64)
            known = {"cells": cells, "beside": np.array(beside), "shift": shift}
            kept.put(_KIND, key, known)
        return Ahead(*known["shift"].tolist()) if known["shift"].size else None


_KIND = "clock"


def past_poles(drives: Sequence[Drive], poles: Sequence[ObservedPole]) -> list[Passage]:
    """What drives had in view of poles, as far as that can show that one was taken down."""
    asked = Asked(Places.of_poles(poles))
    last_seen = last_seen_by(poles, [drive.drive_id for drive in drives])
    since = ((last_seen < number) & drive.is_evidence for number, drive in enumerate(drives))
    return [
        drive.passage(drive.watcher.past(asked, wanted)) for drive, wanted in zip(drives, since, strict=True)
    ]


def past_sites(drives: Sequence[Drive], sites: Sequence[Site]) -> list[Passage]:
    """What drives had in view of sites; the last question: what they were asked is kept."""
    asked = Asked(Places.of_sites(sites))
    passages = [drive.passage(drive.watcher.past(asked)) for drive in drives]
    for drive in drives:
        drive.watcher.keep()
    return passages
