"""Plates of a matched pole against the Skiltplate of its site."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from twin.matching.config import MatchConfig
from twin.matching.plates.readings import PlateHistory, code_chances, family, is_disputed
from twin.matching.plates.texts import text_pairs
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import SKILTPLATE, Plate, Site
from twin.matching.verdicts.finding import Offset, change_id, named, utc_time
from twin.store.kinds import Verdict
from twin.store.records import Finding
from twin.words import Why
from twin.words.reasons import MissingPlate, NewPlate, UnclearType, WrongType, WrongTypeDisputed


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


@dataclass(frozen=True, slots=True)
class PlatesFound:
    """What the plates of a matched pole say.

    Attributes
    ----------
    findings : list of Finding
        Of the plates that differ from NVDB, or may.
    codes : tuple of str
        Code of each plate seen, the readings and NVDB's own word together.
    p_as_known : float
        Probability that the plates of which nothing was found carry NVDB's codes.
    """

    findings: list[Finding]
    codes: tuple[str, ...]
    p_as_known: float


def plate_findings(match: MatchedPole, config: MatchConfig) -> PlatesFound:
    """Pair the plates of a matched pole with NVDB's, and say which differ."""
    pole, site = match.pole, match.site
    if not pole.codes or not site.plates or (pole.codes == site.codes and not pole.disputed):
        return PlatesFound([], pole.codes, 1.0)
    read = pole.readings()
    partner = _pairs(pole, read, site.plates, config)
    findings: list[Finding] = []
    codes = list(pole.codes)
    p_as_known = 1.0
    for k, plate in sorted(partner.items()):
        votes = tuple(r for r in read[k] if not r.epoch_ns or _day(r.epoch_ns // _DAY_NS) >= plate.start_date)
        if not votes:
            continue  # NVDB's version is newer than every drive: what they read may have been changed since
        chance = code_chances(votes, plate.code, config)
        codes[k] = max(chance, key=lambda code: (chance[code], code == plate.code))
        unclear = is_disputed(votes) and chance[codes[k]] < config.review_below
        if unclear:
            findings.append(_unclear_type(match, plate, votes, chance))
        elif codes[k] != plate.code:
            findings.append(_wrong_type(match, plate, votes, codes[k], chance[codes[k]]))
        else:
            p_as_known *= chance[plate.code]
    extra = [codes[k] for k in range(len(codes)) if k not in partner]
    findings += [_new_plate(match, code, extra[:n].count(code)) for n, code in enumerate(extra)]
    # A plate may face the other way: only one that faces like a plate we did see can be missed.
    matched = [plate.nvdb_id for plate in partner.values()]
    facings = {plate.ansiktsside for plate in partner.values()}
    if match.p_gone > 0:
        left = [plate for plate in site.plates if plate.nvdb_id not in matched]
        findings += [_missing_plate(match, plate) for plate in left if plate.ansiktsside in facings]
    return PlatesFound(findings, tuple(codes), p_as_known)


_DAY_NS = 86_400_000_000_000
_EPOCH = dt.date(1970, 1, 1).toordinal()


@lru_cache(maxsize=4096)
def _day(number: int) -> str:
    """ISO date of a number of days since 1970; a fleet drove on few of them."""
    return dt.date.fromordinal(_EPOCH + number).isoformat()


def _pairs(
    pole: ObservedPole, read: Sequence[PlateHistory], plates: Sequence[Plate], config: MatchConfig
) -> dict[int, Plate]:
    """Plate seen → plate of NVDB: equal codes first, then a code that was read, a family, any.

    Plates of equal codes are told apart by their texts. A plate that faces away from every camera is nobody's
    but that of its own code.
    """
    partner: dict[int, Plate] = {}
    if pole.texts:
        for k, j, _ in text_pairs(pole.codes, pole.texts, plates, config):
            if pole.codes[k] == plates[j].code and not is_disputed(read[k]):
                partner[k] = plates[j]
    taken = {plate.nvdb_id for plate in partner.values()}
    left = [plate for plate in plates if plate.nvdb_id not in taken]
    shown = {p.nvdb_id for p in plates if not pole.seen_from_deg or any(map(p.shows_to, pole.seen_from_deg))}
    tests = (
        lambda code, _readings, plate: plate.code == code,
        lambda _code, readings, plate: any(r.code == plate.code for r in readings),
        lambda code, _readings, plate: plate.nvdb_id in shown and family(plate.code) == family(code),
        lambda _code, _readings, plate: plate.nvdb_id in shown,
    )
    # What all drives read alike chooses first: a slip may read like the plate beside it.
    order = sorted(range(len(read)), key=lambda k: is_disputed(read[k]))
    for fits in tests:
        for k in order:
            plate = next((p for p in left if k not in partner and fits(pole.codes[k], read[k], p)), None)
            if plate is not None:
                left.remove(plate)
                partner[k] = plate
    return partner


def _plate_finding(
    match: MatchedPole,
    identity: tuple[object, ...],
    verdict: Verdict,
    why: Why,
    plate: Plate | None,
    seen: str,
    confidence: float,
    terms: Mapping[str, Any] | None = None,
) -> Finding:
    return Finding(
        change_id=change_id(verdict, SKILTPLATE, *identity),
        verdict=verdict,
        why=why,
        confidence=confidence,
        nvdb_type=SKILTPLATE,
        nvdb_id=plate.nvdb_id if plate else None,
        nvdb_version=plate.version if plate else None,
        skiltnummer_nvdb=(plate.code,) if plate and plate.code else (),
        skiltnummer_seen=(seen,) if seen else (),
        distance_m=match.offset.distance_m,
        distance_sigma_m=match.offset.sigma_m,
        drive_ids=match.pole.drive_ids,
        n_sightings=match.pole.n_sightings,
        east_m=match.pole.east_m,
        north_m=match.pole.north_m,
        terms={
            **match.terms,
            **(terms or {}),
            "site": {"nvdb_type": match.site.nvdb_type, "nvdb_id": match.site.nvdb_id},
        },
    )


def _wrong_type(match: MatchedPole, plate: Plate, read: PlateHistory, seen: str, chance: float) -> Finding:
    why: Why = WrongType(plate.nvdb_id, plate.code, seen)
    if is_disputed(read):
        why = WrongTypeDisputed(plate.nvdb_id, plate.code, seen, _codes(read))
    terms = {"readings": _told(read), "code": round(chance, 4)}
    confidence = match.confidence * chance
    return _plate_finding(
        match, (plate.nvdb_id, seen), Verdict.WRONG_TYPE, why, plate, seen, confidence, terms
    )


def _unclear_type(
    match: MatchedPole, plate: Plate, read: PlateHistory, chance: Mapping[str, float]
) -> Finding:
    """Drives contradict each other, and neither an exchange nor a slip is likely enough."""
    seen = max((code for code in chance if code != plate.code), key=lambda code: chance[code])
    why = UnclearType(plate.nvdb_id, plate.code, _codes(read))
    terms = {"readings": _told(read), "code": round(chance[seen], 4)}
    confidence = match.confidence * max(chance.values())
    # Its own kind of question: the plate may be a site of its own, with a review of that.
    return _plate_finding(match, (plate.nvdb_id, "code"), Verdict.REVIEW, why, plate, seen, confidence, terms)


def _codes(read: PlateHistory) -> tuple[str, ...]:
    """What was read, in this order."""
    return tuple(reading.code for reading in read)


def _told(read: PlateHistory) -> list[dict[str, Any]]:
    return [
        {"code": r.code, "drive": r.drive_id, "at": utc_time(r.epoch_ns) if r.epoch_ns else None}
        for r in read
    ]


def _new_plate(match: MatchedPole, seen: str, number: int) -> Finding:
    """One plate more than NVDB has; `number` tells plates of the same code apart."""
    site = match.site
    why = NewPlate(seen, named(site))
    identity = (site.nvdb_type, site.nvdb_id, seen, *([number] if number else []))
    return _plate_finding(match, identity, Verdict.NEW, why, None, seen, match.confidence)


def _missing_plate(match: MatchedPole, plate: Plate) -> Finding:
    why = MissingPlate(plate.nvdb_id, plate.code, named(match.site))
    confidence = match.confidence * match.p_gone
    return _plate_finding(match, (plate.nvdb_id,), Verdict.MISSING, why, plate, "", confidence)
