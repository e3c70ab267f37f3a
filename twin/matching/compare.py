"""Poles beside the sites of NVDB → findings, and what is left of that to the next match."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from twin.matching.absence import evidence_of_absence, still_seen
from twin.matching.asked import Asked
from twin.matching.assign import Assignment, assign
from twin.matching.cells import are_among, cells_of
from twin.matching.drives import Drive, past_poles, past_sites
from twin.matching.left import Results
from twin.matching.poles.poles import ObservedPole
from twin.matching.scope import Scope
from twin.matching.sites import Site, mirror_near, sites_from_mirror
from twin.matching.verdicts.evidence import with_evidence
from twin.matching.verdicts.judge import is_mirrored, judge
from twin.store.records import Estimate, Finding


@dataclass(frozen=True, slots=True)
class Compared:
    """Findings, and the poles and sites that were compared."""

    findings: list[Finding]
    poles: Sequence[ObservedPole]
    current: Sequence[ObservedPole]
    sites: Sequence[Site]
    in_view: BoolArray
    alone: Sequence[ObservedPole]

    def results(self, passed: IntArray, only: IntArray | None) -> Results:
        """What is left of it to the next match: all, or what lies in some cells.

        Parameters
        ----------
        passed : int64 (n,)
            Cells that drives passed: of sites, those there count.
        """
        sites = cells_of(places_of(self.sites))
        now = {pole.key for pole in self.current}
        counted = [
            cells_of(places_of(self.current)),
            sites[are_among(sites, passed)],
            sites[self.in_view],
            cells_of(places_of([pole for pole in self.poles if pole.key not in now])),
            cells_of(places_of(self.alone)),
        ]
        cells, ids = cells_of(places_of(self.findings)), [one.change_id for one in self.findings]
        if only is not None:
            inside = are_among(cells, only)
            ids = [one for one, counts in zip(ids, inside.tolist(), strict=True) if counts]
            cells, counted = cells[inside], [some[are_among(some, only)] for some in counted]
        return Results(ids, cells, counted)


def compare(
    asked: Asked,
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    drives: Sequence[Drive],
    codes: Mapping[str, float],
    scope: Scope | None = None,
    *,
    forgets: bool = False,
) -> Compared:
    """Compare poles with sites.

    Parameters
    ----------
    forgets : bool
        Whether what drives had in view elsewhere is forgotten.
    """
    config = asked.config
    asked.say("finding which signs were in view")
    current = still_seen(poles, past_poles(drives, poles), config)
    about = None if scope is None or forgets else scope.about
    seen = evidence_of_absence(past_sites(drives, sites, about), sites, config)
    asked.say("assigning")
    assignment = assign(current, sites, seen.p_unannotated, config, codes)
    if scope is not None:
        ends = np.concatenate([places_of(current), places_of(sites)])
        scope.check(ends, assignment.groups(), assignment.ends(assignment.gated), config)
    findings = judge(
        current,
        sites,
        assignment,
        seen.complete,
        seen.watched_by,
        config,
        p_unannotated=seen.p_unannotated,
        passed=seen.passed,
        mirrored=None if scope is None else _mirrored(asked, current, sites, assignment, scope),
    )
    findings = with_evidence(findings, current, drives)
    alone = [current[k] for k in np.flatnonzero(assignment.site_of_pole < 0).tolist()]
    return Compared(findings, poles, current, sites, seen.complete >= config.min_views, alone)


def _mirrored(
    asked: Asked,
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    assignment: Assignment,
    scope: Scope,
) -> BoolArray:
    """Whether NVDB has any sign in the neighbourhood of each pole, asked where it matters: of new ones."""
    found = is_mirrored(poles, sites, asked.config)
    inside = are_among(cells_of(places_of(poles)), scope.results)
    left = np.flatnonzero(~found & (assignment.site_of_pole < 0) & inside).tolist()
    if left:
        some = [poles[k] for k in left]
        points, plates = mirror_near(asked.view, places_of(some), asked.config)
        found[left] = is_mirrored(some, sites_from_mirror(points, plates, asked.config), asked.config)
    return found


def places_of(
    some: Sequence[ObservedPole] | Sequence[Estimate] | Sequence[Finding] | Sequence[Site],
) -> FloatArray:
    """East and north (n, 2), EPSG:25833."""
    return np.array([(one.east_m, one.north_m) for one in some]).reshape(-1, 2)
