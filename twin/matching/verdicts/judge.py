"""Pairs and leftovers → verdicts, each with its reason and its terms."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import BoolArray, FloatArray
from twin.matching.assign import Assignment
from twin.matching.config import MatchConfig
from twin.matching.likelihood import TERMS
from twin.matching.plates.readings import family
from twin.matching.plates.texts import texts_compared
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import SKILTPUNKT, Site
from twin.matching.verdicts.finding import (
    Offset,
    change_id,
    named,
    offset_of,
    other_poles,
    other_sites,
    when_seen,
)
from twin.matching.verdicts.judge_plates import MatchedPole, plate_findings
from twin.store.kinds import Verdict
from twin.store.records import Finding
from twin.words import Why
from twin.words.reasons import (
    AsInNvdb,
    Basis,
    CodesAgree,
    Missing,
    Moved,
    New,
    NewOrKnown,
    NoOwnPosition,
    NotObservable,
    OutsideMirror,
    PerhapsMissing,
    StoodHere,
    TextDiffers,
    UnsureOfSite,
    UnsureOrNew,
    UnsureTakenDown,
)


def judge(
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    assignment: Assignment,
    views: NDArray[np.int64],
    complete_drives: Sequence[Sequence[str]],
    config: MatchConfig,
    *,
    p_unannotated: FloatArray | None = None,
    passed: BoolArray | None = None,
    mirrored: BoolArray | None = None,
) -> list[Finding]:
    """Give every pole and every site in view its verdict.

    A site whose position and plates are as NVDB has them gives one ``unchanged``; otherwise each finding is a
    row of its own: the pole's (Skiltpunkt) and one for each plate that differs (Skiltplate).

    Parameters
    ----------
    views : int (n_sites,)
        Frames of completely annotated drives in which the site was in view.
    complete_drives : per site, the ids of those drives
    p_unannotated : float64 (n_sites,), optional
        As :func:`twin.matching.assign.assign` got it. Default: `p_missed` where `views` are enough, else 1.
    passed : bool (n_sites,), optional
        Whether a completely annotated drive had the place in view at all. Default: where there are views.
    mirrored : bool (n_poles,), optional
        Whether NVDB has any sign in a pole's neighbourhood. Default: among these sites.

    Returns
    -------
    list of Finding
        In the order of ``change_id``.
    """
    if p_unannotated is None:
        p_unannotated = np.where(views >= config.min_views, config.p_missed, 1.0)
    scene = _Scene(
        poles=poles,
        sites=sites,
        assignment=assignment,
        views=views,
        drives=complete_drives,
        p_gone=config.p_gone / (config.p_gone + (1 - config.p_gone) * p_unannotated),
        passed=views > 0 if passed is None else passed,
        mirrored=is_mirrored(poles, sites, config) if mirrored is None else mirrored,
        config=config,
    )
    findings: list[Finding] = []
    for index, site_index in enumerate(assignment.site_of_pole.tolist()):
        findings += _new_pole(scene, index) if site_index < 0 else _pair(scene, index, site_index)
    paired = set(assignment.site_of_pole.tolist())
    for j in np.flatnonzero(scene.passed).tolist():
        if j not in paired and sites[j].own_geometry:
            findings += _unseen_site(scene, j)
    return sorted(findings, key=lambda finding: finding.change_id)


def is_mirrored(poles: Sequence[ObservedPole], sites: Sequence[Site], config: MatchConfig) -> BoolArray:
    """Whether the mirror has any sign in the neighbourhood of each pole."""
    from scipy.spatial import cKDTree

    if not poles or not sites:
        return np.zeros(len(poles), dtype=bool)
    tree = cKDTree(np.array([(site.east_m, site.north_m) for site in sites]))
    distance, _ = tree.query(np.array([(pole.east_m, pole.north_m) for pole in poles]))
    return np.asarray(distance <= config.mirrored_m)


@dataclass(frozen=True, slots=True)
class _Scene:
    """Everything that a verdict may rest on; `p_gone` is that of a site to which no pole belongs."""

    poles: Sequence[ObservedPole]
    sites: Sequence[Site]
    assignment: Assignment
    views: NDArray[np.int64]
    drives: Sequence[Sequence[str]]
    p_gone: FloatArray
    passed: BoolArray
    mirrored: BoolArray
    config: MatchConfig

    def confidence(self, index: int) -> float:
        """Probability that a pole still stands and is what it was assigned to."""
        still = 1.0 - self.poles[index].p_taken_down
        return float(self.assignment.confidence_of_pole[index]) * still

    def unsure(self, index: int) -> bool:
        """Whether another reading of a pole is nearly as likely."""
        return self.confidence(index) < self.config.review_below


def _pair(scene: _Scene, index: int, site_index: int) -> list[Finding]:
    """Findings of a pole and the site it was assigned to."""
    pole, site, config = scene.poles[index], scene.sites[site_index], scene.config
    offset = offset_of(pole, site, config)
    confidence = scene.confidence(index)
    enough = scene.views[site_index] >= config.min_views
    match = MatchedPole(
        pole=pole,
        site=site,
        offset=offset,
        confidence=confidence,
        p_gone=float(scene.p_gone[site_index]) if enough else 0.0,
        terms=_pair_terms(scene, index, site, offset),
    )
    if scene.unsure(index):
        return [_pole_finding(Verdict.REVIEW, _unsure(scene, index, match), match, confidence)]
    plates = plate_findings(match, config)
    findings = plates.findings
    match = replace(match, pole=replace(pole, codes=plates.codes))
    if not site.own_geometry:
        lacks = NoOwnPosition(named(site), round(pole.sigma_m, 4), _basis(match))
        return [_pole_finding(Verdict.REVIEW, lacks, match, confidence), *findings]
    if offset.distance_m - config.tolerance_m > config.moved_quantile * offset.sigma_m:
        moved = Moved(named(site), *_rounded(offset), config.tolerance_m, _basis(match))
        return [_pole_finding(Verdict.MOVED, moved, match, confidence * offset.p_beyond), *findings]
    if findings:
        return findings
    confidence *= (1 - offset.p_beyond) * plates.p_as_known
    as_known = AsInNvdb(named(site), *_rounded(offset), _basis(match))
    return [_pole_finding(Verdict.UNCHANGED, as_known, match, confidence)]


def _rounded(offset: Offset) -> tuple[float, float]:
    """Distance and sigma to a tenth of a millimetre."""
    return round(offset.distance_m, 4), round(offset.sigma_m, 4)


def _unsure(scene: _Scene, index: int, match: MatchedPole) -> UnsureTakenDown | UnsureOfSite | UnsureOrNew:
    """What else a pole may be."""
    site, p, basis = named(match.site), round(match.confidence, 4), _basis(match)
    if scene.poles[index].p_taken_down > 1 - scene.assignment.confidence_of_pole[index]:
        return UnsureTakenDown(site, p, basis)
    rival = int(scene.assignment.rival_of_pole[index])
    if rival >= 0:
        return UnsureOfSite(site, p, named(scene.sites[rival]), basis)
    return UnsureOrNew(site, p, basis)


def _basis(match: MatchedPole) -> Basis:
    """What speaks for and against a pair."""
    pole, site, terms = match.pole, match.site, match.terms["log_odds"]
    return Basis(
        sigmas=match.terms["sigmas"] if site.own_geometry else None,
        codes=_codes_agree(pole.codes, site.codes),
        n_codes=len(pole.codes),
        texts=tuple(
            TextDiffers(told["code"], told["seen"], told["nvdb"])
            for told in match.terms.get("texts", ())
            if told["differs"]
        ),
        faces_away=terms["facing"] < 0,
        same_side=terms["side"] > 0 if terms["side"] else None,
        n_drives=len(pole.drive_ids),
    )


def _codes_agree(seen: Sequence[str], known: Sequence[str]) -> CodesAgree:
    if not seen:
        return CodesAgree.NOT_ANNOTATED
    if not known:
        return CodesAgree.NOT_IN_NVDB
    if Counter(seen) == Counter(known):
        return CodesAgree.SAME
    if set(seen) & set(known):
        return CodesAgree.SOME
    kin = {family(code) for code in seen} & {family(code) for code in known}
    return CodesAgree.FAMILY if kin else CodesAgree.OTHER


def _pair_terms(scene: _Scene, index: int, site: Site, offset: Offset) -> dict[str, Any]:
    assignment, pole = scene.assignment, scene.poles[index]
    odds = assignment.terms_of_pole[index].tolist()
    texts = texts_compared(pole.codes, pole.texts, site.plates, scene.config)
    return {
        "match": round(float(assignment.confidence_of_pole[index]), 4),
        "log_odds": {name: round(value, 2) for name, value in zip(TERMS, odds, strict=True)},
        "sigmas": round(offset.distance_m / float(np.hypot(offset.sigma_m, site.sigma_m)), 2),
        "nvdb_sigma_m": round(site.sigma_m, 3),
        "beyond_tolerance": round(offset.p_beyond, 4) if site.own_geometry else None,
        "pole": pole.key,
        "seen": when_seen(pole),
        "taken_down": round(pole.p_taken_down, 4),
        "alternatives": other_sites(assignment.alternatives_of_pole.get(index, ()), scene.sites),
        **({"texts": texts} if texts else {}),
    }


def _pole_finding(verdict: Verdict, why: Why, match: MatchedPole, confidence: float) -> Finding:
    pole, site = match.pole, match.site
    return Finding(
        change_id=change_id(verdict, site.nvdb_type, site.nvdb_id),
        verdict=verdict,
        why=why,
        confidence=confidence,
        nvdb_type=site.nvdb_type,
        nvdb_id=site.nvdb_id,
        nvdb_version=site.version,
        skiltnummer_nvdb=site.codes,
        skiltnummer_seen=pole.codes,
        distance_m=match.offset.distance_m,
        distance_sigma_m=match.offset.sigma_m,
        drive_ids=pole.drive_ids,
        n_sightings=pole.n_sightings,
        east_m=pole.east_m,
        north_m=pole.north_m,
        terms=match.terms,
    )


def _new_pole(scene: _Scene, index: int) -> list[Finding]:
    pole = scene.poles[index]
    rival = int(scene.assignment.rival_of_pole[index])
    verdict, why = Verdict.REVIEW, _why_new(scene, index, rival)
    if isinstance(why, New):
        verdict = Verdict.NEW
    confidence = scene.confidence(index)
    alternatives = scene.assignment.alternatives_of_pole.get(index, ())
    finding = Finding(
        change_id=change_id(verdict, SKILTPUNKT, pole.key),
        verdict=verdict,
        why=why,
        confidence=confidence,
        nvdb_type=SKILTPUNKT,
        nvdb_id=None,
        nvdb_version=None,
        skiltnummer_nvdb=(),
        skiltnummer_seen=pole.codes,
        distance_m=None,
        distance_sigma_m=None,
        drive_ids=pole.drive_ids,
        n_sightings=pole.n_sightings,
        east_m=pole.east_m,
        north_m=pole.north_m,
        terms={
            "match": round(confidence, 4),
            "pole": pole.key,
            "seen": when_seen(pole),
            "taken_down": round(pole.p_taken_down, 4),
            "alternatives": other_sites(alternatives, scene.sites),
        },
    )
    return [finding]


def _why_new(scene: _Scene, index: int, rival: int) -> New | OutsideMirror | NewOrKnown | StoodHere:
    codes, config = scene.poles[index].codes, scene.config
    if not scene.mirrored[index]:
        return OutsideMirror(codes, config.mirrored_m)
    if scene.unsure(index):
        return NewOrKnown(codes, named(scene.sites[rival])) if rival >= 0 else StoodHere(codes)
    return New(codes, config.gate_m)


def _unseen_site(scene: _Scene, j: int) -> list[Finding]:
    """A site that a complete drive passed, and that no pole belongs to."""
    site, config, frames = scene.sites[j], scene.config, int(scene.views[j])
    alone, gone = float(scene.assignment.confidence_of_site[j]), float(scene.p_gone[j])
    alternatives = scene.assignment.alternatives_of_site.get(j, ())
    confidence = alone * gone
    drives = len(scene.drives[j])
    if frames < config.min_views or gone < config.review_below:
        verdict, confidence = Verdict.NOT_OBSERVABLE, 1 - gone
        why: Why = NotObservable(named(site), frames, config.min_views)
    elif confidence >= config.review_below:
        verdict, why = Verdict.MISSING, Missing(named(site), frames, drives)
    elif any(i >= 0 and scene.unsure(i) for i, _ in alternatives):
        return []  # The pole that it may be asks the question already.
    else:
        verdict, why = Verdict.REVIEW, PerhapsMissing(named(site), frames)
    finding = Finding(
        change_id=change_id(verdict, site.nvdb_type, site.nvdb_id),
        verdict=verdict,
        why=why,
        confidence=confidence,
        nvdb_type=site.nvdb_type,
        nvdb_id=site.nvdb_id,
        nvdb_version=site.version,
        skiltnummer_nvdb=site.codes,
        skiltnummer_seen=(),
        distance_m=None,
        distance_sigma_m=None,
        drive_ids=tuple(scene.drives[j]),
        n_sightings=0,
        east_m=site.east_m,
        north_m=site.north_m,
        terms={
            "match": round(alone, 4),
            "absence": {"frames": frames, "drives": drives, "gone": round(gone, 4)},
            "alternatives": other_poles(alternatives, scene.poles),
        },
    )
    return [finding]
