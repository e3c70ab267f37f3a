"""Poles and signs of NVDB about the car → what is said of each, by the rules of a match."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from twin.live.check.poles import DRIVE, Pole
from twin.live.check.verdict import Standing, Verdict
from twin.live.check.watched import SiteId, id_of
from twin.matching.absence import Absence
from twin.matching.assign import assign
from twin.matching.config import MatchConfig
from twin.matching.sites import Site
from twin.matching.verdicts.judge import judge
from twin.store.kinds import Verdict as Matched
from twin.store.records import Finding
from twin.words import Why

_STANDING = {
    Matched.UNCHANGED: Standing.UNCHANGED,
    Matched.MOVED: Standing.MOVED,
    Matched.NEW: Standing.NEW,
    Matched.WRONG_TYPE: Standing.WRONG_TYPE,
    Matched.MISSING: Standing.MISSING,
}
"""What is said; ``review`` and ``not_observable`` say that nothing can be."""

_OF_PLACE = (Matched.UNCHANGED, Matched.MOVED)

Owner = Hashable
"""A sign of NVDB by its id, or a pole that it does not have by the engine's."""


class Subject(NamedTuple):
    """What a verdict is about.

    Attributes
    ----------
    id : str
        As `Verdict.id`.
    owner : hashable
        The sign that it hangs on: what is said of one plate depends on what its pole is.
    site : Site or None
    """

    id: str
    owner: Owner
    site: Site | None

    @classmethod
    def of_site(cls, site: Site) -> Subject:
        """Return a sign of NVDB as a whole."""
        return cls(f"{site.nvdb_type}:{site.nvdb_id}", id_of(site), site)

    def expected(self, at_ns: int) -> Verdict:
        """Say that NVDB has it ahead."""
        assert self.site is not None  # noqa: S101 - of signs of NVDB alone
        site = self.site
        return Verdict(
            id=self.id,
            standing=Standing.EXPECTED,
            was=None,
            why=None,
            is_final=False,
            confidence=math.nan,
            nvdb_type=site.nvdb_type,
            nvdb_id=site.nvdb_id,
            pole="",
            skiltnummer_seen=(),
            skiltnummer_nvdb=site.codes,
            east_m=site.east_m,
            north_m=site.north_m,
            covariance_m2=None,
            distance_m=None,
            distance_sigma_m=None,
            nvdb_m=(site.east_m, site.north_m),
            first_seen_ns=0,
            at_ns=at_ns,
        )

    def taken_back(self, before: Verdict, why: Why | None, at_ns: int) -> Verdict:
        """Say that what was said holds no longer: of a sign of NVDB nothing is known then, as before."""
        if self.site is not None and self.id == Subject.of_site(self.site).id:
            return self.expected(at_ns)._replace(why=why)
        return before._replace(
            standing=Standing.WITHDRAWN, why=why, is_final=False, confidence=math.nan, at_ns=at_ns
        )


@dataclass(frozen=True, slots=True)
class Scene:
    """Everything about some places that verdicts rest on.

    Attributes
    ----------
    poles : sequence of Pole
    sites : sequence of Site
    absence : Absence
        What not having seen the sites says.
    passed, may_miss : bool (n_sites,)
        Whether a site is out of view by now; whether it may then be missing.
    mirrored : bool (n_poles,)
        Whether NVDB has any sign in a pole's neighbourhood.
    common : mapping
        What common codes cost.
    config : MatchConfig
    """

    poles: Sequence[Pole]
    sites: Sequence[Site]
    absence: Absence
    passed: BoolArray
    may_miss: BoolArray
    mirrored: BoolArray
    common: Mapping[str, float]
    config: MatchConfig


@dataclass(frozen=True, slots=True)
class Judged:
    """What is said of a scene.

    Attributes
    ----------
    verdicts : list of (Subject, Verdict)
    doubts : mapping of owner to Why
        Why nothing can be said of it as a whole.
    leaning : set of owners
        Poles that are surely NVDB's and not final, of whose place it is not sure enough whether it is NVDB's
        too: what was said before stays.
    in_place : set of owners
        Final ones of that kind that are more surely where NVDB has them than a review asks for: `UNCHANGED`
        stays, nothing else does.
    paired : set of SiteId
        Signs that a pole surely is.
    """

    verdicts: list[tuple[Subject, Verdict]] = field(default_factory=list)
    doubts: dict[Owner, Why] = field(default_factory=dict)
    leaning: set[Owner] = field(default_factory=set)
    in_place: set[Owner] = field(default_factory=set)
    paired: set[SiteId] = field(default_factory=set)

    def keeps(self, subject: Subject, before: Standing) -> bool:
        """Whether what was said of a subject stays, though nothing is said of it now."""
        is_whole = subject.site is not None and subject.id == Subject.of_site(subject.site).id
        stays = is_whole and before is Standing.UNCHANGED and subject.owner in self.in_place
        return stays or subject.owner in self.leaning


def judged(scene: Scene, places_m: FloatArray, within_m: float) -> tuple[Judged, set[Owner]]:
    """Judge a scene.

    Parameters
    ----------
    places_m : float64 (n, 2)
    within_m : float
        What stands further from all these places may compete with others that are not there.

    Returns
    -------
    Judged, set of owners
        Of everything, and those of which it counts.
    """
    found = Judged()
    poles, config = {one.seen.key: one for one in scene.poles}, scene.config
    sites: dict[SiteId | None, int] = {id_of(site): j for j, site in enumerate(scene.sites)}
    seen = [one.seen for one in scene.poles]
    assignment = assign(seen, scene.sites, scene.absence.p_unannotated, config, scene.common)
    findings = judge(
        seen,
        scene.sites,
        assignment,
        np.where(scene.passed, scene.absence.complete, 0),
        scene.absence.watched_by,
        config,
        p_unannotated=scene.absence.p_unannotated,
        passed=scene.absence.passed & scene.may_miss,
        mirrored=scene.mirrored,
    )
    for k, j in enumerate(assignment.site_of_pole.tolist()):
        if j >= 0 and assignment.confidence_of_pole[k] >= config.review_below:
            found.paired.add(id_of(scene.sites[j]))
    for finding in findings:
        pole = poles.get(finding.terms.get("pole", ""))
        number = sites.get(_site_of(finding), -1)
        site = None if number < 0 else scene.sites[number]
        subject = _subject(finding, pole, site)
        if _holds(finding, pole, config):
            is_final = pole is None or (pole.is_final and (number < 0 or _is_over(scene, number)))
            found.verdicts.append((subject, _verdict(finding, subject, pole, is_final=is_final)))
        elif finding.verdict in _OF_PLACE and pole is not None:
            if not pole.is_final:
                found.leaning.add(subject.owner)
            elif _p_in_place(finding) >= config.review_below:
                found.in_place.add(subject.owner)
        if subject.site is None or finding.verdict is not Matched.UNCHANGED:
            found.doubts.setdefault(subject.owner, finding.why)
    return found, _inside(scene, places_m, within_m)


def _is_over(scene: Scene, number: int) -> bool:
    """Whether a sign is out of view, or never was in it."""
    return bool(scene.passed[number]) or not scene.absence.complete[number]


def _inside(scene: Scene, places_m: FloatArray, within_m: float) -> set[Owner]:
    """Owners of what stands near some places, whatever its objects were called before they were joined."""
    inside: set[Owner] = set()
    for site in scene.sites:
        if _away_m(site.east_m, site.north_m, places_m) <= within_m:
            inside.add(id_of(site))
    for pole in scene.poles:
        if _away_m(pole.seen.east_m, pole.seen.north_m, places_m) <= within_m:
            inside.update(member.removeprefix(f"{DRIVE}:") for member in pole.seen.members)
    return inside


def _away_m(east_m: float, north_m: float, places_m: FloatArray) -> float:
    return float(np.hypot(places_m[:, 0] - east_m, places_m[:, 1] - north_m).min())


def _site_of(finding: Finding) -> SiteId | None:
    """The sign of NVDB that a finding is about, or on which its plate hangs."""
    site = finding.terms.get("site")
    if site is not None:
        return site["nvdb_type"], site["nvdb_id"]
    return None if finding.nvdb_id is None else (finding.nvdb_type, finding.nvdb_id)


def _subject(finding: Finding, pole: Pole | None, site: Site | None) -> Subject:
    name = "" if pole is None else pole.id
    if site is None:
        return Subject(name, name, None)
    of_plate = "site" in finding.terms
    if not of_plate:
        return Subject.of_site(site)
    if finding.nvdb_id is None:
        return Subject(f"{name}/{';'.join(finding.skiltnummer_seen)}", id_of(site), site)
    # A plate without a Skiltpunkt is the sign itself: of its code as of its place something may be said.
    alone = "/code" if (finding.nvdb_type, finding.nvdb_id) == id_of(site) else ""
    return Subject(f"{finding.nvdb_type}:{finding.nvdb_id}{alone}", id_of(site), site)


def _holds(finding: Finding, pole: Pole | None, config: MatchConfig) -> bool:
    """Whether a finding is sure enough to be said now.

    What a match would put up for review is not said. That a place is NVDB's or is not is said once that is
    likely by all that is known, also of one that is final: the drive may end while it is far ahead, known to
    metres. One frame alone shows neither that a sign is new nor that it was moved.
    """
    if finding.verdict not in _STANDING:
        return False
    if pole is None:
        return True
    if pole.of_one_frame and finding.verdict in (Matched.NEW, Matched.MOVED):
        return False
    return finding.verdict not in _OF_PLACE or finding.confidence >= config.review_below


def _p_in_place(finding: Finding) -> float:
    """Return the probability that a pole is its sign of NVDB, and within the tolerance of its place."""
    p_beyond = finding.terms["beyond_tolerance"]
    return 0.0 if p_beyond is None else float(finding.terms["match"] * (1.0 - p_beyond))


def _verdict(finding: Finding, subject: Subject, pole: Pole | None, *, is_final: bool) -> Verdict:
    site = subject.site
    return Verdict(
        id=subject.id,
        standing=_STANDING[finding.verdict],
        was=None,
        why=finding.why,
        is_final=is_final,
        confidence=finding.confidence,
        nvdb_type=finding.nvdb_type,
        nvdb_id=finding.nvdb_id,
        pole="" if pole is None else pole.id,
        skiltnummer_seen=finding.skiltnummer_seen,
        skiltnummer_nvdb=finding.skiltnummer_nvdb,
        east_m=finding.east_m,
        north_m=finding.north_m,
        covariance_m2=None if pole is None else pole.covariance_m2,
        distance_m=finding.distance_m,
        distance_sigma_m=finding.distance_sigma_m,
        nvdb_m=None if site is None else (site.east_m, site.north_m),
        first_seen_ns=0 if pole is None else pole.seen.first_ns,
        at_ns=0,
    )
