"""Match the store's estimates against its mirror of NVDB and keep the findings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_from_geographic
from twin import __version__
from twin.errors import StoreError
from twin.matching.absence import evidence_of_absence, still_seen
from twin.matching.assign import assign
from twin.matching.config import MatchConfig
from twin.matching.drives import Drive, beside_nvdb, drives_of, past_poles, past_sites
from twin.matching.in_view import COARSE_DEG
from twin.matching.kept import Kept
from twin.matching.news import News
from twin.matching.poles.keys import Mark, with_known_keys
from twin.matching.poles.many_drives import with_fused_places
from twin.matching.poles.map_aided import map_aided
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.matching.poles.same_pole import each_pole_once, may_be_one
from twin.matching.poles.seen_in import known_marks, marks_of, pictures_of, seen_from
from twin.matching.save import save_changes
from twin.matching.sites import Site, along_the_road, mirror_near, sites_from_mirror
from twin.matching.verdicts.finding import doubtful_as_review
from twin.matching.verdicts.judge import judge
from twin.mirror.vegnett.network import FACT as VEGNETT
from twin.store import schema
from twin.store.kinds import Method, Verdict
from twin.store.records import Estimate, Finding
from twin.store.store import Row, Snapshot, Store, utc_now
from twin.words import sentence


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
        Observed poles; NVDB sites near a drive that have any position.
    n_in_view : int
        Sites that a completely annotated drive had in view.
    n_outdated : int
        Poles of earlier drives that a later, completely annotated drive passed without seeing them: left out.
    map_aided : str
        What measured signs did to the poles, if these were asked to; "" if not.
    news : News or None
        What the match before did not find; None of the first one.
    warnings : tuple of str
        Drives that do not fit themselves, and complete ones that cannot show that a sign is missing.
    kept_agree : bool or None
        Whether what was kept of earlier matches gives the same findings; None where that was not asked for,
        or the store changed meanwhile.
    """

    method: str
    verdicts: dict[Verdict, int]
    n_poles: int
    n_sites: int
    n_in_view: int
    n_outdated: int
    map_aided: str
    news: News | None = None
    warnings: tuple[str, ...] = ()
    kept_agree: bool | None = None


def match(
    store: Store,
    *,
    method: str | None = None,
    config: MatchConfig | None = None,
    progress: Callable[[str], None] | None = None,
    anew: bool = False,
) -> MatchReport:
    """Compare every estimate of one method with the mirror, and replace the store's findings.

    What earlier matches worked out of drives and places that nothing has touched is taken from the store
    (:mod:`twin.matching.kept`): the findings are those of a match without it.

    Parameters
    ----------
    store : Store
    method : str, optional
        Default: the best that drives were ingested by, in the order of :class:`twin.store.kinds.Method`.
    config : MatchConfig, optional
    anew : bool
        Work everything out, and say whether what was kept agrees.

    Raises
    ------
    StoreError
        No drive was ingested, nothing was synced, or no drive was ingested by the method.
    """
    if store.read_only is not None:  # at once, not after the work
        raise store.read_only
    config = config or MatchConfig()
    say = progress or (lambda _text: None)
    method = choose_method(store, method)
    if store.fact("mirror") is None:
        raise StoreError(f"The store {store.name} has no NVDB signs yet: run `twin sync-nvdb` first.")
    found = _found(store, method, config, say, anew=anew)
    kept_agree = None
    if anew:
        say("matching once more from what was kept")
        again = _found(store, method, config, lambda _text: None, anew=False)
        if again.observed.revision == found.observed.revision:
            kept_agree = repr((again.findings, again.keys)) == repr((found.findings, found.keys))
    observed, drives, findings = found.observed, found.drives, found.findings
    settings = _settings(method, config, drives, observed.estimates) | {"road_network": observed.has_network}
    digest = hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()
    run = {"method": method, "at": utc_now(), "settings": settings, "config_sha256": digest}
    news = save_changes(
        store, findings, found.keys, {**run, "revision": observed.revision}, observed.marks, found.kept
    )
    return MatchReport(
        method=method,
        verdicts=_counts(findings),
        n_poles=found.n_current,
        n_sites=found.n_sites,
        n_in_view=found.n_in_view,
        n_outdated=len(found.poles) - found.n_current,
        map_aided=found.map_aided,
        news=news,
        kept_agree=kept_agree,
        warnings=tuple(warning for drive in drives for warning in drive.warnings()),
    )


@dataclass(frozen=True, slots=True)
class _Found:
    """What a match found, and what it rests on; ``n_current``: poles that no later drive missed."""

    observed: _Observed
    drives: list[Drive]
    poles: list[ObservedPole]
    findings: list[Finding]
    n_current: int
    n_sites: int
    n_in_view: int
    map_aided: str
    kept: Kept

    @property
    def keys(self) -> dict[str, str]:
        """Key of the pole that each estimate belongs to."""
        return {member: pole.key for pole in self.poles for member in pole.members}


def _found(
    store: Store, method: str, config: MatchConfig, say: Callable[[str], None], *, anew: bool
) -> _Found:
    """Compare; nothing is written."""
    with store.snapshot() as view:
        say("grouping estimates into poles")
        kept = Kept() if anew else Kept.of_store(view)
        observed = _observed(view, method, config, kept)
    poles = observed.poles
    sites = _sites(store, observed.points, observed.plates, config, has_network=observed.has_network)
    drives = beside_nvdb(observed.drives, sites, observed.once, kept)
    tied = ""
    if config.map_aided:
        say("tying drives to measured signs")
        poles, tied = map_aided(poles, sites, observed.once, [drive.driven for drive in drives], config, kept)
    say("finding which signs were in view")
    current = still_seen(poles, past_poles(drives, poles), config)
    seen = evidence_of_absence(past_sites(drives, sites), sites, config)
    say("assigning")
    assignment = assign(current, sites, seen.p_unannotated, config)
    findings = judge(
        current,
        sites,
        assignment,
        seen.complete,
        seen.watched_by,
        config,
        p_unannotated=seen.p_unannotated,
        passed=seen.passed,
    )
    findings = _with_evidence(findings, current, drives)
    return _Found(
        observed=observed,
        drives=drives,
        poles=poles,
        findings=findings,
        n_current=len(current),
        n_sites=len(sites),
        n_in_view=int((seen.complete >= config.min_views).sum()),
        map_aided=tied,
        kept=kept,
    )


@dataclass(frozen=True, slots=True)
class _Observed:
    """What a match compares, read in one snapshot: drives, their estimates and poles, NVDB's rows near them.

    ``once``: estimates of which each pole has one a drive and camera.
    """

    revision: int
    drives: list[Drive]
    estimates: list[Estimate]
    once: list[Estimate]
    poles: list[ObservedPole]
    marks: dict[str, Mark]
    has_network: bool
    points: list[Row]
    plates: list[Row]


def _observed(view: Snapshot, method: str, config: MatchConfig, kept: Kept) -> _Observed:
    """Read what was ingested by the method, put it together to poles, and NVDB's signs near it."""
    drives = drives_of(view, method, config, kept)
    # What is no sign has nothing to be compared with in a mirror of signs.
    is_sign = schema.estimate.c.nvdb_type.is_(None)
    asked = sa.select(schema.estimate).where(schema.estimate.c.method == method, is_sign)
    estimates = [Estimate.from_row(row) for row in view.rows(asked.order_by(schema.estimate.c.estimate_id))]
    has_network = view.fact(VEGNETT) is not None
    directions = seen_from(view, estimates, method) if has_network else {}
    pairs = may_be_one(estimates, config)
    once = each_pole_once(estimates, pairs, pictures_of(view, pairs, method))
    found = observed_poles(once, [drive.drive_id for drive in drives], config, directions)
    found = with_fused_places(found, once, [drive.driven for drive in drives], kept=kept).poles
    marks = marks_of(view, estimates, method)
    poles = with_known_keys(found, marks, known_marks(view))
    points, plates = mirror_near(view, _places(drives, poles), config)
    # The revision is that of what is matched: a sync or an ingest that lands meanwhile makes findings stale.
    return _Observed(view.revision(), drives, estimates, once, poles, marks, has_network, points, plates)


def _with_evidence(
    findings: Sequence[Finding], poles: Sequence[ObservedPole], drives: Sequence[Drive]
) -> list[Finding]:
    """Put drives that are not trusted up for review, and add covariances and cameras."""
    doubted = doubtful_as_review(
        findings, {drive.drive_id: drive.doubt for drive in drives if drive.doubt is not None}
    )
    measured = {(pole.east_m, pole.north_m): pole.covariance_m2 for pole in poles}
    watched = _Cameras.of(poles, drives)
    return [
        replace(finding, covariance_m2=_covariance(finding, measured), cameras=watched.for_finding(finding))
        for finding in doubted
    ]


def choose_method(store: Store, method: str | None) -> str:
    """Return `method` if drives were ingested by it; by default the best one that some were."""
    present = store.methods()
    if not present:
        raise StoreError(f"The store {store.name} has no drive yet: run `twin ingest-drive` first.")
    if method is None:
        return next((name for name in Method if name in present), present[0])
    if method not in present:
        raise StoreError(
            f"No drive in the store {store.name} was ingested by --method {method}, only by "
            f"{', '.join(present)}: run `twin ingest-drive --method {method}` first."
        )
    return method


def _settings(
    method: str, config: MatchConfig, drives: Sequence[Drive], estimates: Sequence[Estimate]
) -> dict[str, Any]:
    """Everything that findings depend on but NVDB: by its SHA-256 two runs are known to be alike.

    A drive's files (``drive.toml`` among them) are known by their hash. How it was ingested (terrain, error
    budget, installed grids) is known by what came of it: the hash of its estimates.
    """
    digests = {drive.drive_id: hashlib.sha256() for drive in drives}
    for estimate in sorted(estimates, key=lambda e: e.estimate_id):
        row = estimate.to_row()
        values = [row[name] for name in _HASHED]
        digests[estimate.drive_id].update(json.dumps(values, sort_keys=True).encode())
    return {
        "software": f"nvdb-twin {__version__}",
        "method": method,
        "matching": asdict(config),
        "drives": {
            drive.drive_id: {
                "content_sha256": drive.content_sha256,
                "estimates_sha256": digests[drive.drive_id].hexdigest(),
                "complete": drive.is_evidence,
                "doubt": "" if drive.doubt is None else sentence(drive.doubt),
            }
            for drive in drives
        },
    }


_HASHED = (
    "object",
    "east_m",
    "north_m",
    "cov_ee_m2",
    "cov_en_m2",
    "cov_nn_m2",
    "skiltnummer",
    "text",
    "cameras",
)


def _places(drives: Sequence[Drive], poles: Sequence[ObservedPole]) -> FloatArray:
    """Where something was seen, or driven past: EPSG:25833, to some hundred metres."""
    coarse = np.unique(np.concatenate([drive.watcher.coarse for drive in drives]), axis=0) * COARSE_DEG
    east, north = utm33_from_geographic(*coarse.T)
    seen = np.array([(pole.east_m, pole.north_m) for pole in poles]).reshape(-1, 2)
    return np.concatenate([np.stack([east, north], axis=1), seen])


def _sites(
    store: Store, points: Sequence[Row], plates: Sequence[Row], config: MatchConfig, *, has_network: bool
) -> list[Site]:
    """Sites of the mirror; with the road network also which way they face, and their road."""
    if not has_network:
        return sites_from_mirror(points, plates, config)
    from twin.mirror.vegnett import facing, load_vegnett

    sites = sites_from_mirror(points, plates, config, facing(store))
    return along_the_road(sites, load_vegnett(store))


@dataclass(frozen=True, slots=True)
class _Cameras:
    """Cameras that saw each pole, by its key, and those of each drive that were annotated."""

    of_pole: Mapping[str, frozenset[str]]
    of_drive: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, poles: Sequence[ObservedPole], drives: Sequence[Drive]) -> _Cameras:
        return cls({pole.key: pole.cameras for pole in poles}, {d.drive_id: d.cameras for d in drives})

    def for_finding(self, finding: Finding) -> tuple[str, ...]:
        """Their names; of a sign that was not seen, the cameras of the drives that looked for it."""
        of_pole = self.of_pole.get(finding.terms.get("pole", ""))
        if of_pole is not None:
            names = {camera.partition("/")[2] for camera in of_pole}
        else:
            names = {name for drive in finding.drive_ids for name in self.of_drive.get(drive, ())}
        return tuple(sorted(names))


def _covariance(
    finding: Finding, measured: Mapping[tuple[float, float], FloatArray]
) -> tuple[float, float, float] | None:
    """Covariance of the measured position; None where a finding stands at NVDB's position."""
    covariance_m2 = measured.get((finding.east_m, finding.north_m))
    if covariance_m2 is None:
        return None
    (ee, en), (_, nn) = covariance_m2.tolist()
    return ee, en, nn


def _counts(findings: Sequence[Finding]) -> dict[Verdict, int]:
    counts = dict.fromkeys(Verdict, 0)
    for finding in findings:
        counts[finding.verdict] += 1
    return counts
