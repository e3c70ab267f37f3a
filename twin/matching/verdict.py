"""Pairs and leftovers → verdicts, each with its reason in one sentence."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.matching.assign import Assignment, family
from twin.matching.config import MatchConfig
from twin.matching.observed import ObservedPole
from twin.matching.sites import SKILTPLATE, SKILTPUNKT, Plate, Site

VERDICTS = ("unchanged", "moved", "wrong_type", "new", "missing", "review")


@dataclass(frozen=True, slots=True)
class Change:
    """One finding. Field names are the columns of the ``changes`` layer.

    ``east_m, north_m`` (EPSG:25833) is where the sign stands now: the measured position, or NVDB's for
    what was not seen.
    """

    change_id: str
    verdict: str
    reason: str
    confidence: float
    nvdb_type: int
    nvdb_id: int | None
    nvdb_version: int | None
    skiltnummer_nvdb: str
    skiltnummer_seen: str
    distance_m: float | None
    distance_sigma_m: float | None
    drive_ids: str
    n_sightings: int
    east_m: float
    north_m: float


def judge(
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    assignment: Assignment,
    views: NDArray[np.int64],
    complete_drives: Sequence[Sequence[str]],
    config: MatchConfig,
) -> list[Change]:
    """Give every pole and every site in view its verdict.

    A site whose position and plates are as NVDB has them gives one ``unchanged``; otherwise each finding is a
    row of its own: the pole's (Skiltpunkt) and one for each plate that differs (Skiltplate).

    Parameters
    ----------
    views : int (n_sites,)
        Frames of completely annotated drives in which the site was in view.
    complete_drives : per site, the ids of those drives

    Returns
    -------
    list of Change
        In the order of ``change_id``.
    """
    changes: list[Change] = []
    mirrored = _mirrored(poles, sites, config)
    for index, pole in enumerate(poles):
        site_index = int(assignment.site_of_pole[index])
        confidence = float(assignment.confidence_of_pole[index])
        if site_index < 0:
            rival = int(assignment.rival_of_pole[index])
            changes.append(
                _new_pole(
                    pole, confidence, sites[rival] if rival >= 0 else None, bool(mirrored[index]), config
                )
            )
            continue
        seen_fully = views[site_index] >= config.min_views
        changes += _pair(pole, sites[site_index], confidence, bool(seen_fully), config)
    paired = set(assignment.site_of_pole.tolist())
    for j, site in enumerate(sites):
        if j in paired or not site.own_geometry or views[j] < config.min_views:
            continue
        confidence = float(assignment.confidence_of_site[j])
        changes.append(_missing_pole(site, int(views[j]), complete_drives[j], confidence, config))
    return sorted(changes, key=lambda change: change.change_id)


def change_id(*identity: object) -> str:
    """Twelve hex digits of the finding's identity: the same finding has the same id in every run."""
    return hashlib.sha256("|".join(str(part) for part in identity).encode()).hexdigest()[:12]


def _pair(
    pole: ObservedPole, site: Site, confidence: float, seen_fully: bool, config: MatchConfig
) -> list[Change]:
    """Findings of a pole and the site it was assigned to."""
    if confidence < config.review_below:
        reason = (
            f"{_name(site)} is the likeliest match ({confidence:.0%}), but another is nearly as likely: "
            "look before deciding."
        )
        return [_pole_change("review", reason, pole, site, confidence)]
    if not site.own_geometry:
        reason = f"NVDB places {_name(site)} only on the road's centre line: here is a measured position."
        return [_pole_change("review", reason, pole, site, confidence)]
    distance, sigma = _distance(pole, site)
    findings = _plate_findings(pole, site, confidence, seen_fully)
    if distance - config.tolerance_m > config.moved_quantile * sigma:
        reason = (
            f"{_name(site)} stands {distance:.2f} m (± {sigma:.2f} m) from NVDB's position, "
            f"beyond the tolerance of {config.tolerance_m:.1f} m."
        )
        certain = confidence * _phi((distance - config.tolerance_m) / sigma)
        return [_pole_change("moved", reason, pole, site, certain), *findings]
    if findings:
        return findings
    reason = f"{_name(site)} stands where NVDB has it: {distance:.2f} m off, ± {sigma:.2f} m."
    if not pole.codes:
        reason = reason[:-1] + "; its sign code was not annotated."
    return [_pole_change("unchanged", reason, pole, site, confidence)]


def _phi(z: float) -> float:
    """Standard normal distribution function."""
    return 0.5 * (1.0 + math.erf(z / math.sqrt(2.0)))


def _distance(pole: ObservedPole, site: Site) -> tuple[float, float]:
    """Distance from NVDB's position and our one sigma along that direction, metres."""
    offset = np.array([pole.east_m - site.east_m, pole.north_m - site.north_m])
    distance = float(np.hypot(*offset))
    if distance < 1e-6:
        return distance, pole.sigma_m
    direction = offset / distance
    return distance, float(np.sqrt(direction @ pole.covariance_m2 @ direction))


def _pole_change(verdict: str, reason: str, pole: ObservedPole, site: Site, confidence: float) -> Change:
    distance, sigma = _distance(pole, site)
    return Change(
        change_id=change_id(verdict, site.nvdb_type, site.nvdb_id),
        verdict=verdict,
        reason=reason,
        confidence=confidence,
        nvdb_type=site.nvdb_type,
        nvdb_id=site.nvdb_id,
        nvdb_version=site.version,
        skiltnummer_nvdb=";".join(site.codes),
        skiltnummer_seen=";".join(pole.codes),
        distance_m=distance,
        distance_sigma_m=sigma,
        drive_ids=",".join(pole.drive_ids),
        n_sightings=pole.n_sightings,
        east_m=pole.east_m,
        north_m=pole.north_m,
    )


def _mirrored(poles: Sequence[ObservedPole], sites: Sequence[Site], config: MatchConfig) -> NDArray[np.bool_]:
    """Whether the mirror has any sign in the neighbourhood of each pole."""
    from scipy.spatial import cKDTree

    if not poles or not sites:
        return np.zeros(len(poles), dtype=bool)
    tree = cKDTree(np.array([(site.east_m, site.north_m) for site in sites]))
    distance, _ = tree.query(np.array([(pole.east_m, pole.north_m) for pole in poles]))
    return np.asarray(distance <= config.mirrored_m)


def _new_pole(
    pole: ObservedPole, confidence: float, rival: Site | None, mirrored: bool, config: MatchConfig
) -> Change:
    codes = " ".join(pole.codes) or "a sign without an annotated code"
    if not mirrored:
        verdict = "review"
        reason = (
            f"{codes} stands here, and the mirror has no sign at all within {config.mirrored_m:.0f} m: is "
            "this place inside the mirrored area?"
        )
    elif confidence < config.review_below and rival is not None:
        verdict = "review"
        reason = f"{codes}: either new, or {_name(rival)} moved or changed: look before deciding."
    else:
        verdict = "new"
        reason = f"{codes} stands here, and no sign of NVDB within {config.gate_m:.0f} m is left for it."
    return Change(
        change_id=change_id(verdict, SKILTPUNKT, pole.key),
        verdict=verdict,
        reason=reason,
        confidence=confidence,
        nvdb_type=SKILTPUNKT,
        nvdb_id=None,
        nvdb_version=None,
        skiltnummer_nvdb="",
        skiltnummer_seen=";".join(pole.codes),
        distance_m=None,
        distance_sigma_m=None,
        drive_ids=",".join(pole.drive_ids),
        n_sightings=pole.n_sightings,
        east_m=pole.east_m,
        north_m=pole.north_m,
    )


def _missing_pole(
    site: Site, views: int, drives: Sequence[str], confidence: float, config: MatchConfig
) -> Change:
    verdict = "missing" if confidence >= config.review_below else "review"
    reason = (
        f"{_name(site)} was not seen, though its place was in view in {views} frames of a completely "
        "annotated drive."
    )
    return Change(
        change_id=change_id(verdict, site.nvdb_type, site.nvdb_id),
        verdict=verdict,
        reason=reason,
        confidence=confidence,
        nvdb_type=site.nvdb_type,
        nvdb_id=site.nvdb_id,
        nvdb_version=site.version,
        skiltnummer_nvdb=";".join(site.codes),
        skiltnummer_seen="",
        distance_m=None,
        distance_sigma_m=None,
        drive_ids=",".join(drives),
        n_sightings=0,
        east_m=site.east_m,
        north_m=site.north_m,
    )


def _plate_findings(pole: ObservedPole, site: Site, confidence: float, seen_fully: bool) -> list[Change]:
    """Plates of a matched pole that differ: equal codes pair first, then the same family, then the rest."""
    if not pole.codes or not site.plates:
        return []
    seen, known = list(pole.codes), list(site.plates)
    matched: list[Plate] = []
    for code in list(seen):
        plate = next((p for p in known if p.code == code), None)
        if plate is not None:
            seen.remove(code)
            known.remove(plate)
            matched.append(plate)
    findings: list[Change] = []
    for same_family in (True, False):
        for code in list(seen):
            plate = next((p for p in known if not same_family or family(p.code) == family(code)), None)
            if plate is not None:
                seen.remove(code)
                known.remove(plate)
                matched.append(plate)
                findings.append(_wrong_type(pole, site, plate, code, confidence))
    findings += [
        _new_plate(pole, site, code, seen[:k].count(code), confidence) for k, code in enumerate(seen)
    ]
    # A plate may face the other way: only one that faces like a plate we did see can be missed.
    facings = {plate.ansiktsside for plate in matched}
    if seen_fully:
        gone = [plate for plate in known if plate.ansiktsside in facings]
        findings += [_missing_plate(pole, site, plate, confidence) for plate in gone]
    return findings


def _plate_change(
    identity: tuple[object, ...],
    verdict: str,
    reason: str,
    pole: ObservedPole,
    site: Site,
    plate: Plate | None,
    seen: str,
    confidence: float,
) -> Change:
    distance, sigma = _distance(pole, site)
    return Change(
        change_id=change_id(verdict, SKILTPLATE, *identity),
        verdict=verdict,
        reason=reason,
        confidence=confidence,
        nvdb_type=SKILTPLATE,
        nvdb_id=plate.nvdb_id if plate else None,
        nvdb_version=plate.version if plate else None,
        skiltnummer_nvdb=plate.code if plate else "",
        skiltnummer_seen=seen,
        distance_m=distance,
        distance_sigma_m=sigma,
        drive_ids=",".join(pole.drive_ids),
        n_sightings=pole.n_sightings,
        east_m=pole.east_m,
        north_m=pole.north_m,
    )


def _wrong_type(pole: ObservedPole, site: Site, plate: Plate, seen: str, confidence: float) -> Change:
    reason = f"Skiltplate {plate.nvdb_id} is {plate.code or 'without a code'} in NVDB, but {seen} was seen."
    return _plate_change((plate.nvdb_id, seen), "wrong_type", reason, pole, site, plate, seen, confidence)


def _new_plate(pole: ObservedPole, site: Site, seen: str, number: int, confidence: float) -> Change:
    """One plate more than NVDB has; `number` tells plates of the same code apart."""
    reason = f"{seen} was seen on {_name(site)}, where NVDB has no such plate."
    return _plate_change(
        (site.nvdb_type, site.nvdb_id, seen, *([number] if number else [])),
        "new",
        reason,
        pole,
        site,
        None,
        seen,
        confidence,
    )


def _missing_plate(pole: ObservedPole, site: Site, plate: Plate, confidence: float) -> Change:
    reason = (
        f"Skiltplate {plate.nvdb_id} ({plate.code}) was not seen on {_name(site)}, whose other plates were, "
        "in a completely annotated drive."
    )
    return _plate_change((plate.nvdb_id,), "missing", reason, pole, site, plate, "", confidence)


def _name(site: Site) -> str:
    kind = "Skiltpunkt" if site.nvdb_type == SKILTPUNKT else "Skiltplate"
    codes = f" ({', '.join(site.codes)})" if site.codes else ""
    return f"{kind} {site.nvdb_id}{codes}"
