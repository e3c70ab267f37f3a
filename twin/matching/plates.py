"""Plates of a matched pole against the Skiltplate of its site."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from twin.matching.assign import family
from twin.matching.change import Change, Offset, change_id, name_of
from twin.matching.observed import ObservedPole
from twin.matching.sites import SKILTPLATE, Plate, Site


@dataclass(frozen=True, slots=True)
class MatchedPole:
    """A pole and the site it was assigned to.

    Attributes
    ----------
    confidence : float
        That the pair is right.
    p_gone : float
        That a plate of the site that was not seen is gone; 0 where no drive can tell.
    terms : mapping
        What the pair rests on.
    """

    pole: ObservedPole
    site: Site
    offset: Offset
    confidence: float
    p_gone: float
    terms: Mapping[str, Any]


def plate_findings(match: MatchedPole) -> list[Change]:
    """Plates of a matched pole that differ: equal codes pair first, then the same family, then the rest."""
    pole, site = match.pole, match.site
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
                findings.append(_wrong_type(match, plate, code))
    findings += [_new_plate(match, code, seen[:k].count(code)) for k, code in enumerate(seen)]
    # A plate may face the other way: only one that faces like a plate we did see can be missed.
    facings = {plate.ansiktsside for plate in matched}
    if match.p_gone > 0:
        findings += [_missing_plate(match, plate) for plate in known if plate.ansiktsside in facings]
    return findings


def _plate_change(
    match: MatchedPole,
    identity: tuple[object, ...],
    verdict: str,
    reason: str,
    plate: Plate | None,
    seen: str,
    confidence: float,
) -> Change:
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
        distance_m=match.offset.distance_m,
        distance_sigma_m=match.offset.sigma_m,
        drive_ids=",".join(match.pole.drive_ids),
        n_sightings=match.pole.n_sightings,
        east_m=match.pole.east_m,
        north_m=match.pole.north_m,
        terms={**match.terms, "site": {"nvdb_type": match.site.nvdb_type, "nvdb_id": match.site.nvdb_id}},
    )


def _wrong_type(match: MatchedPole, plate: Plate, seen: str) -> Change:
    reason = f"Skiltplate {plate.nvdb_id} is {plate.code or 'without a code'} in NVDB, but {seen} was seen."
    identity = (plate.nvdb_id, seen)
    return _plate_change(match, identity, "wrong_type", reason, plate, seen, match.confidence)


def _new_plate(match: MatchedPole, seen: str, number: int) -> Change:
    """One plate more than NVDB has; `number` tells plates of the same code apart."""
    site = match.site
    reason = f"{seen} was seen on {name_of(site)}, where NVDB has no such plate."
    identity = (site.nvdb_type, site.nvdb_id, seen, *([number] if number else []))
    return _plate_change(match, identity, "new", reason, None, seen, match.confidence)


def _missing_plate(match: MatchedPole, plate: Plate) -> Change:
    reason = (
        f"Skiltplate {plate.nvdb_id} ({plate.code}) was not seen on {name_of(match.site)}, whose other "
        "plates were, in a completely annotated drive."
    )
    confidence = match.confidence * match.p_gone
    return _plate_change(match, (plate.nvdb_id,), "missing", reason, plate, "", confidence)
