"""Match the store's estimates against its mirror of NVDB and keep the findings."""

from __future__ import annotations

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
from geoloc.rig import rig_from_document, without_template_masks
from geoloc.trajectory import Poses
from geoloc.visibility import count_views
from twin import schema
from twin.errors import StoreError
from twin.matching.assign import assign
from twin.matching.config import MatchConfig
from twin.matching.observed import observed_poles
from twin.matching.sites import Site, sites_from_mirror
from twin.matching.verdict import VERDICTS, Change, judge
from twin.store import Store, utc_now

Row = Mapping[str, Any]


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
    """

    method: str
    verdicts: dict[str, int]
    n_poles: int
    n_sites: int
    n_in_view: int


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
        Default: the best that the store has estimates of (``single-frame`` before ``paper``).
    config : MatchConfig, optional

    Raises
    ------
    StoreError
        No drive was ingested, nothing was synced, or the method has no estimates.
    """
    config = config or MatchConfig()
    say = progress or (lambda _text: None)
    method = choose_method(store, method)
    if store.fact("mirror") is None:
        raise StoreError(f"The store {store.path} has no NVDB signs yet: run `twin sync-nvdb` first.")
    drives = store.rows(sa.select(schema.drive).order_by(schema.drive.c.started_ns, schema.drive.c.drive_id))
    estimates = store.rows(sa.select(schema.estimate).where(schema.estimate.c.method == method))
    say("grouping estimates into poles")
    poles = observed_poles(estimates, [d["drive_id"] for d in drives], config)
    sites = sites_from_mirror(
        store.rows(sa.select(*_columns(schema.skiltpunkt))),
        store.rows(sa.select(*_columns(schema.skiltplate))),
        config,
    )
    say("finding which signs were in view")
    complete, views, watched_by = _views(drives, sites, config)
    p_unannotated = np.where(
        complete >= config.min_views, config.p_missed, np.where(views > 0, config.p_unseen, 1.0)
    )
    say("assigning")
    assignment = assign(poles, sites, p_unannotated, config)
    changes = judge(poles, sites, assignment, complete, watched_by, config)
    store.save_changes([asdict(change) for change in changes], {"method": method, "at": utc_now()})
    return MatchReport(
        method=method,
        verdicts=_counts(changes),
        n_poles=len(poles),
        n_sites=len(sites),
        n_in_view=int((complete >= config.min_views).sum()),
    )


METHODS = ("single-frame", "paper")
"""Geolocation methods, best first."""


def choose_method(store: Store, method: str | None) -> str:
    """Return `method` if the store has estimates by it; by default the best one that it has."""
    if not store.count(schema.drive):
        raise StoreError(f"The store {store.path} has no drive yet: run `twin ingest-drive` first.")
    present = store.methods()
    if method is None:
        # Drives without any estimate can still show that signs are missing.
        return next((name for name in METHODS if name in present), METHODS[0])
    if method not in present:
        raise StoreError(
            f"The store {store.path} has no estimates by --method {method}, only by "
            f"{', '.join(present) or 'none'}: run `twin ingest-drive --method {method}` first."
        )
    return method


def _columns(table: sa.Table) -> list[sa.Column[Any]]:
    """Every column but the compressed original, which matching does not need."""
    return [column for column in table.columns if column.name != "raw"]


def _counts(changes: Sequence[Change]) -> dict[str, int]:
    counts = dict.fromkeys(VERDICTS, 0)
    for change in changes:
        counts[change.verdict] += 1
    return counts


def _views(
    drives: Sequence[Row], sites: Sequence[Site], config: MatchConfig
) -> tuple[NDArray[np.int64], NDArray[np.int64], list[list[str]]]:
    """Frames in view per site: over completely annotated drives, over all; and which complete drives."""
    complete = np.zeros(len(sites), dtype=np.int64)
    every = np.zeros(len(sites), dtype=np.int64)
    watched_by: list[list[str]] = [[] for _ in sites]
    if not sites:
        return complete, every, watched_by
    lat, lon = geographic_from_utm33(
        np.array([site.east_m for site in sites]), np.array([site.north_m for site in sites])
    )
    for drive in drives:
        document = json.loads(zlib.decompress(drive["rig"]))
        rig, _ = without_template_masks(rig_from_document(document, source=drive["name"]))
        seen = count_views(
            rig,
            poses_from_blob(drive["poses"]),
            lat,
            lon,
            max_range_m=config.view_range_m,
            cameras=drive["cameras"],
        )
        every += seen
        if drive["annotations_complete"]:
            complete += seen
            for j in np.flatnonzero(seen):
                watched_by[int(j)].append(drive["drive_id"])
    return complete, every, watched_by


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
