"""What changed signs of NVDB can change in findings: cells, and drives that they judge anew."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geoloc.arrays import IntArray
from twin.matching.asked import Asked, sites_of
from twin.matching.cells import CELL_M, NOWHERE, are_among, cells_of, middles_of
from twin.matching.compare import places_of
from twin.matching.drives import Drive, beside_nvdb, cells_if_shifted, clock_cells, drives_of
from twin.matching.kept import Kept
from twin.matching.left import KnownDrive, State, cells_counted
from twin.matching.poles.same_pole import each_pole_once, may_be_one
from twin.matching.poles.seen_in import pictures_of
from twin.matching.reading import estimates_of
from twin.matching.sites import Site, mirror_near, sites_from_mirror
from twin.store.records import Estimate

_DIAGONAL_M = CELL_M * math.sqrt(2.0)
_BESIDE_M = 256.0
"""So near to a pole that NVDB does not have, it nearly always has some other sign."""


def cells_of_signs(asked: Asked, kept: Kept, state: State, changed: IntArray) -> IntArray:
    """Cells whose findings change with NVDB's signs in some cells, but for what they say of drives.

    Parameters
    ----------
    changed : int64 (n,)
        Cells in which signs are or were otherwise, sorted.
    """
    return np.unique(np.concatenate([state.beside_drives(changed), _alone(asked, kept, changed)]))


def drives_judged_anew(asked: Asked, kept: Kept, state: State, changed: IntArray) -> set[str]:
    """Drives that now are, or no longer are, shifted against NVDB's signs: all that they say may change."""
    view, method, config = asked.view, asked.method, asked.config
    reach = {one: clock_cells(kept, one) for one in state.near(changed)}
    ids = {drive_id for drive_id, cells in reach.items() if are_among(cells, changed).any()}
    known = {one: drive for one in sorted(ids) if (drive := KnownDrive.of(kept, one)) is not None}
    if not known:
        return set()
    drives = drives_of(view, method, config, kept, known, known)
    estimates = estimates_of(view, method, known)
    pairs = may_be_one(estimates, config)
    once = each_pole_once(estimates, pairs, pictures_of(view, pairs, method))
    sites = sites_that_judge(
        asked, kept, drives, once, np.unique(np.concatenate([reach[one] for one in known]))
    )
    judged = beside_nvdb(drives, sites, once, kept)
    return {
        one.drive_id
        for one in judged
        # Where other cells tell of a clock now, its drive is to be found by these.
        if one.shift != known[one.drive_id].ahead
        or not np.array_equal(reach[one.drive_id], clock_cells(kept, one.drive_id))
    }


def sites_that_judge(
    asked: Asked, kept: Kept, drives: Sequence[Drive], estimates: Sequence[Estimate], cells: IntArray
) -> list[Site]:
    """Sites in some cells, and all by which the clocks of drives are judged.

    Parameters
    ----------
    estimates : sequence of Estimate
        All of these drives, one a pole, and maybe of others.
    cells : int64 (n,)
        Those of these are among them.
    """
    mine: dict[str, list[Estimate]] = {drive.drive_id: [] for drive in drives}
    for one in estimates:
        if one.drive_id in mine:
            mine[one.drive_id].append(one)
    sites = sites_of(asked, mirror_near(asked.view, middles_of(cells), asked.config, CELL_M), kept)
    more = [cells_if_shifted(drive, mine[drive.drive_id], sites) for drive in drives]
    wider = np.unique(np.concatenate([cells, *more]))
    if wider.size == cells.size:
        return sites
    return sites_of(asked, mirror_near(asked.view, middles_of(wider), asked.config, CELL_M), kept)


def _alone(asked: Asked, kept: Kept, changed: IntArray) -> IntArray:
    """Cells of poles without a sign of NVDB, beside which the nearest one may have come or gone.

    Whether NVDB has any sign in the neighbourhood tells a new sign from one outside the mirrored area.
    """
    from scipy.spatial import cKDTree

    within_m = asked.config.mirrored_m
    cells = cells_counted(kept, "alone", changed, within_m + CELL_M)
    if not cells.size:
        return NOWHERE
    far_m, _ = cKDTree(middles_of(changed)).query(middles_of(cells))
    cells = cells[far_m <= within_m + _DIAGONAL_M]
    if not cells.size:
        return NOWHERE
    beside_m = min(_BESIDE_M, within_m)
    points, plates = mirror_near(asked.view, middles_of(cells), asked.config, beside_m)
    stay = places_of(sites_from_mirror(points, plates, asked.config))
    stay = stay[~are_among(cells_of(stay), changed)]
    if not len(stay):
        return cells
    near_m, _ = cKDTree(stay).query(middles_of(cells))
    return cells[near_m > within_m - _DIAGONAL_M / 2]
