"""Match the store's estimates against its mirror of NVDB and keep the findings."""

from __future__ import annotations

import datetime as dt
import io
import json
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray

from geoloc.geodesy import geographic_from_utm33
from geoloc.rig import Rig, rig_from_document, without_template_masks
from geoloc.trajectory import Poses
from geoloc.visibility import count_views
from twin import schema
from twin.errors import StoreError
from twin.matching.assign import assign
from twin.matching.config import MatchConfig
from twin.matching.observed import ObservedPole, observed_poles
from twin.matching.sites import Site, sites_from_mirror
from twin.matching.verdict import VERDICTS, Change, judge
from twin.store import Snapshot, Store, utc_now

Row = Mapping[str, Any]
IntArray = NDArray[np.int64]

METHODS = ("adjusted", "single-frame", "paper")
"""Geolocation methods, best first."""


@dataclass(frozen=True, slots=True)
class MatchReport:
    """What a match found.

    Attributes
    ----------
    method : str
        Whose estimates were matched.
    verdicts : dict
        Verdict → number of findings, every verdict named.
    n_poles, n_sites : int
        Observed poles; NVDB sites that have any position.
    n_in_view : int
        Sites that a completely annotated drive had in view.
    n_outdated : int
        Poles of earlier drives that a later, completely annotated drive passed without seeing them: left out.
    """

    method: str
    verdicts: dict[str, int]
    n_poles: int
    n_sites: int
    n_in_view: int
    n_outdated: int


def match(
    store: Store,
    *,
    method: str | None = None,
    config: MatchConfig | None = None,
    progress: Callable[[str], None] | None = None,
) -> MatchReport:
    """Compare every estimate of one method with the mirror, and replace the store's findings.

    Parameters
    ----------
    store : Store
    method : str, optional
        Default: the best that drives were ingested by, in the order of `METHODS`.
    config : MatchConfig, optional

    Raises
    ------
    StoreError
        No drive was ingested, nothing was synced, or no drive was ingested by the method.
    """
    config = config or MatchConfig()
    say = progress or (lambda _text: None)
    method = choose_method(store, method)
    if store.fact("mirror") is None:
        raise StoreError(f"The store {store.path} has no NVDB signs yet: run `twin sync-nvdb` first.")
    with store.snapshot() as view:
        say("grouping estimates into poles")
        drives = _drives(view, method)
        estimates = view.rows(sa.select(schema.estimate).where(schema.estimate.c.method == method))
        known = {row["member"]: row["pole"] for row in view.rows(sa.select(schema.pole_key))}
        poles = observed_poles(estimates, [drive.drive_id for drive in drives], config, known)
        sites = sites_from_mirror(
            view.rows(sa.select(*_columns(schema.skiltpunkt))),
            view.rows(sa.select(*_columns(schema.skiltplate))),
            config,
        )
    say("finding which signs were in view")
    current = _still_seen(drives, poles, config)
    seen = _views_of_sites(drives, sites, config)
    say("assigning")
    assignment = assign(current, sites, seen.p_unannotated(config), config)
    changes = judge(current, sites, assignment, seen.complete, seen.watched_by, config)
    keys = {member: pole.key for pole in poles for member in pole.members}
    store.save_changes([asdict(change) for change in changes], keys, {"method": method, "at": utc_now()})
    return MatchReport(
        method=method,
        verdicts=_counts(changes),
        n_poles=len(current),
        n_sites=len(sites),
        n_in_view=int((seen.complete >= config.min_views).sum()),
        n_outdated=len(poles) - len(current),
    )


def choose_method(store: Store, method: str | None) -> str:
    """Return `method` if drives were ingested by it; by default the best one that some were."""
    present = store.methods()
    if not present:
        raise StoreError(f"The store {store.path} has no drive yet: run `twin ingest-drive` first.")
    if method is None:
        return next((name for name in METHODS if name in present), present[0])
    if method not in present:
        raise StoreError(
            f"No drive in the store {store.path} was ingested by --method {method}, only by "
            f"{', '.join(present)}: run `twin ingest-drive --method {method}` first."
        )
    return method


@dataclass(frozen=True, slots=True)
class _Drive:
    """What matching needs of a drive.

    ``is_evidence``: whether a sign that it passed and did not see is gone. It is, if the drive was declared
    completely annotated and every annotated object found its place: one that did not may be that very sign.
    """

    drive_id: str
    day: str
    is_evidence: bool
    rig: Rig
    poses: Poses
    cameras: tuple[str, ...]

    def views(self, east: NDArray[np.float64], north: NDArray[np.float64], config: MatchConfig) -> IntArray:
        """Count the camera images that had each place in view."""
        if not len(east):
            return np.zeros(0, dtype=np.int64)
        lat, lon = geographic_from_utm33(east, north)
        return count_views(
            self.rig, self.poses, lat, lon, max_range_m=config.view_range_m, cameras=list(self.cameras)
        )


def _drives(view: Snapshot, method: str) -> list[_Drive]:
    """Drives ingested by the method, in time order; only these can have seen or missed a sign."""
    d, m = schema.drive, schema.drive_method
    statement = (
        sa.select(d, m.c.n_unplaced)
        .join(m, (m.c.drive_id == d.c.drive_id) & (m.c.method == method))
        .order_by(d.c.started_ns, d.c.drive_id)
    )
    drives = []
    for row in view.rows(statement):
        document = json.loads(zlib.decompress(row["rig"]))
        rig, _ = without_template_masks(rig_from_document(document, source=row["name"]))
        drives.append(
            _Drive(
                drive_id=row["drive_id"],
                day=dt.datetime.fromtimestamp(row["started_ns"] / 1e9, tz=dt.UTC).date().isoformat(),
                is_evidence=bool(row["annotations_complete"]) and row["n_unplaced"] == 0,
                rig=rig,
                poses=poses_from_blob(row["poses"]),
                cameras=tuple(row["cameras"]),
            )
        )
    return drives


def _still_seen(
    drives: Sequence[_Drive], poles: Sequence[ObservedPole], config: MatchConfig
) -> list[ObservedPole]:
    """Leave out poles that a later drive passed, completely annotated, without seeing them."""
    east = np.array([pole.east_m for pole in poles])
    north = np.array([pole.north_m for pole in poles])
    last_seen = np.array(
        [max(i for i, d in enumerate(drives) if d.drive_id in pole.drive_ids) for pole in poles],
        dtype=np.int64,
    )
    gone = np.zeros(len(poles), dtype=bool)
    for i, drive in enumerate(drives):
        if drive.is_evidence and (last_seen < i).any():
            gone |= (last_seen < i) & (drive.views(east, north, config) >= config.min_views)
    return [pole for pole, is_gone in zip(poles, gone, strict=True) if not is_gone]


@dataclass(frozen=True, slots=True)
class _Views:
    """Camera images in which each site was in view.

    Attributes
    ----------
    complete : int (n_sites,)
        Of drives that are evidence of absence.
    every : int (n_sites,)
        Of all drives.
    watched_by : per site, the ids of the drives that are evidence
    """

    complete: IntArray
    every: IntArray
    watched_by: list[list[str]]

    def p_unannotated(self, config: MatchConfig) -> NDArray[np.float64]:
        """Probability that a pole that stands at the site goes unannotated."""
        return np.where(
            self.complete >= config.min_views, config.p_missed, np.where(self.every > 0, config.p_unseen, 1.0)
        )


def _views_of_sites(drives: Sequence[_Drive], sites: Sequence[Site], config: MatchConfig) -> _Views:
    east = np.array([site.east_m for site in sites])
    north = np.array([site.north_m for site in sites])
    starts = np.array([site.start_date for site in sites], dtype=np.str_)
    views = _Views(np.zeros(len(sites), np.int64), np.zeros(len(sites), np.int64), [[] for _ in sites])
    for drive in drives:
        # What NVDB says was put up later than the drive could not be seen.
        seen = np.where(starts <= drive.day, drive.views(east, north, config), 0)
        views.every[:] += seen
        if drive.is_evidence:
            views.complete[:] += seen
            for j in np.flatnonzero(seen):
                views.watched_by[int(j)].append(drive.drive_id)
    return views


def _columns(table: sa.Table) -> list[sa.Column[Any]]:
    """Every column but the compressed original, which matching does not need."""
    return [column for column in table.columns if column.name != "raw"]


def _counts(changes: Sequence[Change]) -> dict[str, int]:
    counts = dict.fromkeys(VERDICTS, 0)
    for change in changes:
        counts[change.verdict] += 1
    return counts


def blob_from_poses(poses: Poses) -> bytes:
    """Pack valid poses for the store (NumPy ``.npz``, compressed)."""
    keep = poses.valid
    fields = {name: getattr(poses, name)[keep] for name in Poses.__slots__}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **fields)
    return buffer.getvalue()


def poses_from_blob(blob: bytes) -> Poses:
    """Unpack what :func:`blob_from_poses` packed."""
    with np.load(io.BytesIO(blob), allow_pickle=False) as arrays:
        return Poses(**{name: arrays[name] for name in Poses.__slots__})
