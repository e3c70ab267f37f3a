"""What findings of every verdict have in common: ids, names, distances, when, and doubts of a drive."""

from __future__ import annotations

import datetime as dt
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from twin.matching.assign import Alternatives
from twin.matching.config import MatchConfig
from twin.matching.likelihood import moved_density
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Site
from twin.store.kinds import Verdict
from twin.store.records import Finding
from twin.words.reasons import Doubtful, DriveDoubted, SignSite


def change_id(*identity: object) -> str:
    """Twelve hex digits of the finding's identity: the same finding has the same id in every run."""
    return hashlib.sha256("|".join(str(part) for part in identity).encode()).hexdigest()[:12]


def named(site: Site) -> SignSite:
    """What a reason says of a site."""
    return SignSite(site.nvdb_type, site.nvdb_id, site.codes)


@dataclass(frozen=True, slots=True)
class Offset:
    """A pole against NVDB's position.

    Attributes
    ----------
    distance_m : float
    sigma_m : float
        Our one sigma along that direction, by the fused covariance.
    p_beyond : float
        Probability that the pole stands further from NVDB's position than the tolerance.
    """

    distance_m: float
    sigma_m: float
    p_beyond: float


def offset_of(pole: ObservedPole, site: Site, config: MatchConfig) -> Offset:
    """Measure a pole against NVDB's position.

    The probability weighs two readings by how well they explain the distance: NVDB's position is as good as
    it says (then the pole stands between it and our measurement, the nearer to ours the better that is), or
    the sign was moved (then only our measurement says where it stands). The fused covariance is a bound: it
    holds even if all drives make the same errors. Here the errors that each drive makes for itself
    (`MatchConfig.own_share`) are averaged; else NVDB's position would be trusted too much beside ours.
    """
    east, north = pole.east_m - site.east_m, pole.north_m - site.north_m
    distance = math.hypot(east, north)
    (ee, en), (_, nn) = pole.covariance_m2.tolist()
    if distance < 1e-6:
        variance = (ee + nn) / 2
    else:
        variance = (ee * east**2 + 2 * en * east * north + nn * north**2) / distance**2
    bound = math.sqrt(variance)
    variance *= 1 - config.own_share * (1 - pole.averaged)
    sigma = math.sqrt(variance)
    both = site.sigma_m**2 + variance
    in_place = (1 - config.p_moved) * math.exp(-0.5 * distance**2 / both) / (2 * math.pi * both)
    moved = config.p_moved * float(moved_density(distance, config))
    share = site.sigma_m**2 / both
    beyond = in_place * _phi((share * distance - config.tolerance_m) / max(math.sqrt(share) * sigma, 1e-9))
    beyond += moved * _phi((distance - config.tolerance_m) / max(sigma, 1e-9))
    return Offset(distance, bound, beyond / (in_place + moved))


def _phi(z: float) -> float:
    """Standard normal distribution function."""
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


def when_seen(pole: ObservedPole) -> dict[str, Any]:
    """Time of the first and last sighting, and in how many drives."""
    known = pole.last_ns > 0
    return {
        "first": utc_time(pole.first_ns) if known else None,
        "last": utc_time(pole.last_ns) if known else None,
        "drives": len(pole.drive_ids),
    }


def utc_time(epoch_ns: int) -> str:
    """``2026-05-28T20:26:40Z``."""
    moment = dt.datetime.fromtimestamp(epoch_ns // 1_000_000_000, tz=dt.UTC)
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def other_sites(alternatives: Alternatives, sites: Sequence[Site]) -> list[dict[str, Any]]:
    """Alternatives of a pole: other sites, or none."""
    return [
        {
            "nvdb_type": sites[j].nvdb_type if j >= 0 else None,
            "nvdb_id": sites[j].nvdb_id if j >= 0 else None,
            "probability": round(p, 4),
        }
        for j, p in alternatives
    ]


def other_poles(alternatives: Alternatives, poles: Sequence[ObservedPole]) -> list[dict[str, Any]]:
    """Alternatives of a site: poles that it may be, or none."""
    return [{"pole": poles[i].key if i >= 0 else None, "probability": round(p, 4)} for i, p in alternatives]


_CLAIMS = (Verdict.NEW, Verdict.MOVED, Verdict.WRONG_TYPE, Verdict.MISSING)


def doubtful_as_review(findings: Sequence[Finding], doubts: Mapping[str, DriveDoubted]) -> list[Finding]:
    """Turn what contradicts NVDB into ``review`` where it rests on a drive whose positions are not trusted.

    Parameters
    ----------
    doubts : mapping of drive id to DriveDoubted
        Of the drives that are not trusted alone.
    """

    def judged(finding: Finding) -> Finding:
        doubt = next((doubts[one] for one in finding.drive_ids if one in doubts), None)
        if doubt is None or finding.verdict not in _CLAIMS:
            return finding
        return replace(
            finding,
            # An id of its own: the same site may have another review.
            change_id=change_id(Verdict.REVIEW, finding.change_id),
            verdict=Verdict.REVIEW,
            why=Doubtful(doubt, finding.verdict.value, finding.why),
        )

    return sorted(map(judged, findings), key=lambda finding: finding.change_id)
