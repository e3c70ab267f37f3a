"""What the drives of a store saw of each place, and did not: read from the last match, never kept.

A drive that was completely annotated, and whose absence counts (:mod:`twin.matching.drives`), says of every
place whose front it had in view whether it saw a sign there. Any other drive says what it saw, and nothing
about what it did not see. Which seen pole is which sign of NVDB's is what the last match found, with its
probability.
"""

from __future__ import annotations

import datetime as dt
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray

from geoloc.arrays import BoolArray, FloatArray, IntArray
from twin.errors import RefusedError
from twin.matching.absence import Passage, evidence_of_absence
from twin.matching.assign import assign
from twin.matching.config import MatchConfig
from twin.matching.drives import Drive, drives_of, past_sites
from twin.matching.in_view import Asked, Places
from twin.matching.kept import Kept
from twin.matching.poles.poles import ObservedPole
from twin.matching.poles.seen_in import seen_from
from twin.matching.sites import SKILTPLATE, SKILTPUNKT, Site, sites_from_mirror
from twin.mirror.vegnett import facing
from twin.mirror.vegnett.network import FACT as VEGNETT
from twin.store import schema
from twin.store.kinds import Verdict
from twin.store.records import Estimate, split_codes
from twin.store.store import Row, Snapshot, Store

SiteId = tuple[int, int]
"""Vegobjekttype and NVDB's id."""


@dataclass(frozen=True, slots=True)
class Passed:
    """What one drive says of places, in the order of :attr:`Evidence.place_m`.

    Attributes
    ----------
    started_ns : int
    rows : int64 (k,)
        Places of which it says anything.
    seen : bool (k,)
        Whether it saw the pole that is taken for the place's.
    counts : bool (k,)
        Whether it also says something if it did not see it.
    p_seen : float64 (k,)
        Chance that it sees a sign which stands there and is not hidden.
    """

    started_ns: int
    rows: IntArray
    seen: BoolArray
    counts: BoolArray
    p_seen: FloatArray


@dataclass(frozen=True, slots=True)
class Evidence:
    """Places, NVDB's first, and what drives say of them.

    Attributes
    ----------
    sites : list of Site
        NVDB's.
    found : list of ObservedPole
        Poles that drives found and that are none of these, those that later drives missed among them.
    pair_odds : float64 (n_sites,)
        Odds that the pole taken for the site's is the site's, by all but whether a sign stands there; 0 where
        there is none.
    verdicts : mapping of SiteId, or a pole's key, to Verdict
        What the last match says.
    passes : list of Passed
        In time order.
    last_seen_ns : int64 (n,)
        Epoch at which a pole was last seen that is taken for the place's; 0 where none was.
    config : MatchConfig
        Of the last match.
    """

    sites: list[Site]
    found: list[ObservedPole]
    pair_odds: FloatArray
    verdicts: Mapping[SiteId | str, Verdict]
    passes: list[Passed]
    last_seen_ns: IntArray
    config: MatchConfig

    @property
    def codes(self) -> list[tuple[str, ...]]:
        """Sign codes of each place's plates."""
        return [*(site.codes for site in self.sites), *(pole.codes for pole in self.found)]


def evidence_of(store: Store) -> Evidence:
    """Read it from a store whose last match is up to date.

    Raises
    ------
    StoreError
        Nothing was matched yet.
    RefusedError
        Drives or mirror have changed since, or an older twin has matched.
    """
    with store.snapshot() as view:
        last = view.matched()
        settings = last.get("settings", {})
        if "drives" not in settings:
            raise RefusedError(
                f"The last match of the store {store.name} is of an older twin, which kept too little: "
                "run `twin match` again first."
            )
        config, told = _config(settings["matching"]), settings["drives"]
        drives = drives_of(view, last["method"], config, Kept(view))
        said = _Said.of(view)
        poles = _Poles(view, last["method"])
        sites = _sites(view, store, config)
        # Drives that came after the match would have been refused.
        trusted = [bool(told[drive.drive_id]["complete"]) for drive in drives]
        passages = past_sites(drives, sites)
        passages = [
            Passage(one.drive_id, one.started_ns, is_evidence, one.counts)
            for one, is_evidence in zip(passages, trusted, strict=True)
        ]
        absence = evidence_of_absence(passages, sites, config)
        gone = poles.observed([key for key in poles.names() if key not in said.poles], view)
        taken_down = _paired(gone, sites, said.pairs.keys(), absence.p_unannotated, config)
        pairs = {**said.perhaps, **taken_down, **said.pairs}
        firm = said.paired | {pair.pole for pair in taken_down.values()}
        found = poles.observed([key for key in poles.names() if key not in firm], view)
        # Poses of drives are read where they are needed, as long as the view is open.
        mine = [pairs.get((site.nvdb_type, site.nvdb_id), _NO_PAIR) for site in sites]
        seen_in = [poles.drives.get(pair.pole, {}) for pair in mine] + [
            poles.drives[pole.key] for pole in found
        ]
        asked = Asked(Places.of_poles(found)) if found else None
        witness = _Witness.of(sites, seen_in, config)
        return Evidence(
            sites=sites,
            found=found,
            pair_odds=_odds(mine, absence.p_unannotated, config),
            verdicts=said.verdicts,
            passes=[
                witness.says(one, trusted[k], passages[k].counts.fronts, asked)
                for k, one in enumerate(drives)
            ],
            last_seen_ns=np.array([max(one.values(), default=0) for one in seen_in], dtype=np.int64),
            config=config,
        )


def _config(settings: Mapping[str, object]) -> MatchConfig:
    """Settings of the last match; those that a later version added have their usual values."""
    known = {field.name for field in fields(MatchConfig)}
    return MatchConfig(**{name: value for name, value in settings.items() if name in known})  # type: ignore[arg-type]


def _sites(view: Snapshot, store: Store, config: MatchConfig) -> list[Site]:
    """Every site of the mirror, as matching makes them, so that what it kept of them is found again."""
    points, plates = (view.rows(_needed(schema.MIRROR[one].visible)) for one in (SKILTPUNKT, SKILTPLATE))
    faces = facing(store) if view.fact(VEGNETT) is not None else None
    return sites_from_mirror(points, plates, config, faces)


_NOT_NEEDED = frozenset(
    {"raw", "kommuner", "problems", "last_modified", "road_reference", "skiltnummer_text"}
)


def _needed(table: sa.Table) -> sa.Select[Any]:
    return sa.select(*(column for column in table.columns if column.name not in _NOT_NEEDED))


class _Pair(NamedTuple):
    """The pole taken for a site's, how probably it is, and the log odds of what they have in common."""

    pole: str
    probability: float
    log_odds: float = math.nan


_NO_PAIR = _Pair("", 0.0)


@dataclass(frozen=True, slots=True)
class _Said:
    """What the last match says: a pole and its probability for each site, and every verdict.

    ``perhaps``: of sites without a pole, the one that may be theirs. ``poles``: keys of all that it names.
    """

    pairs: dict[SiteId, _Pair]
    perhaps: dict[SiteId, _Pair]
    verdicts: dict[SiteId | str, Verdict]
    poles: frozenset[str]

    @property
    def paired(self) -> frozenset[str]:
        """Keys of poles that are some site's."""
        return frozenset(pair.pole for pair in self.pairs.values())

    @classmethod
    def of(cls, view: Snapshot) -> _Said:
        t = schema.change.c
        pairs: dict[SiteId, _Pair] = {}
        verdicts: dict[SiteId | str, Verdict] = {}
        perhaps: dict[SiteId, _Pair] = {}
        asked = sa.select(t.nvdb_type, t.nvdb_id, t.verdict, t.terms).order_by(t.nvdb_type, t.change_id)
        for row in view.rows(asked):
            terms, verdict = row["terms"], Verdict(row["verdict"])
            site, pole = _site_of(row), terms.get("pole")
            if site is None:
                verdicts[pole] = verdict
                continue
            # The pole's own verdict comes before those of its plates.
            verdicts.setdefault(site, verdict)
            if pole is not None:
                told = math.fsum(value for name, value in terms["log_odds"].items() if name != "presence")
                pairs[site] = _Pair(pole, float(terms["match"]), told)
            else:
                others = [
                    _Pair(one["pole"], one["probability"]) for one in terms["alternatives"] if one["pole"]
                ]
                if others:
                    perhaps[site] = max(others, key=lambda other: other.probability)
        poles = {pair.pole for pair in pairs.values()} | {key for key in verdicts if isinstance(key, str)}
        return cls(pairs, perhaps, verdicts, frozenset(poles))


def _site_of(row: Row) -> SiteId | None:
    """NVDB's site that a finding is about: of a plate its pole; None of a pole that NVDB does not have."""
    pole = row["terms"].get("site")
    if pole is not None:
        return pole["nvdb_type"], pole["nvdb_id"]
    return None if row["nvdb_id"] is None else (row["nvdb_type"], row["nvdb_id"])


class _Poles:
    """Poles of the last match by their keys, those left out as taken down too."""

    def __init__(self, view: Snapshot, method: str) -> None:
        self._method = method
        is_sign = schema.estimate.c.nvdb_type.is_(None)
        asked = sa.select(schema.estimate).where(schema.estimate.c.method == method, is_sign)
        names = ("drive_id", "object", "last_ns")
        columns = view.columns(asked.with_only_columns(*(schema.estimate.c[name] for name in names)))
        last = {f"{d}:{o}": (d, ns) for d, o, ns in zip(*(columns[name] for name in names), strict=True)}
        self.drives: dict[str, dict[str, int]] = {}
        """Key → drive → when it last saw the pole."""
        self._members: dict[str, list[str]] = {}
        for row in view.rows(sa.select(schema.pole_key)):
            if row["member"] in last:
                drive_id, last_ns = last[row["member"]]
                seen = self.drives.setdefault(row["pole"], {})
                seen[drive_id] = max(last_ns, seen.get(drive_id, 0))
                self._members.setdefault(row["pole"], []).append(row["member"])

    def names(self) -> list[str]:
        """Of all poles, in a fixed order."""
        return sorted(self.drives)

    def observed(self, keys: Sequence[str], view: Snapshot) -> list[ObservedPole]:
        """Poles as matching has them, each at its best estimate."""
        members = [member for key in keys for member in self._members[key]]
        if not members:
            return []
        estimates = {one.member: one for one in self._estimates(view, members)}
        directions = {}
        if view.fact(VEGNETT) is not None:
            directions = seen_from(view, list(estimates.values()), self._method)
        return [self._pole(key, estimates, directions) for key in keys]

    def _estimates(self, view: Snapshot, members: Sequence[str]) -> Iterator[Estimate]:
        columns = [schema.estimate.c[name] for name in _OF_ESTIMATES]
        for start in range(0, len(members), _AT_ONCE):
            ids = [f"{member}:{self._method}" for member in members[start : start + _AT_ONCE]]
            for row in view.rows(sa.select(*columns).where(schema.estimate.c.estimate_id.in_(ids))):
                ee, en, nn = (row[f"cov_{axes}_m2"] for axes in ("ee", "en", "nn"))
                codes = split_codes(row["skiltnummer"])
                kept = {name: row[name] for name in _AS_THEY_ARE}
                yield Estimate(**kept, codes=codes, covariance_m2=(ee, en, nn), cameras=())

    def _pole(
        self, key: str, estimates: Mapping[str, Estimate], directions: Mapping[str, frozenset[float]]
    ) -> ObservedPole:
        mine = [estimates[member] for member in self._members[key]]
        best = min(mine, key=lambda one: (one.covariance_m2[0] + one.covariance_m2[2], one.member))
        ee, en, nn = best.covariance_m2
        return ObservedPole(
            members=tuple(self._members[key]),
            key=key,
            east_m=best.east_m,
            north_m=best.north_m,
            covariance_m2=np.array([[ee, en], [en, nn]]),
            codes=best.codes,
            drive_ids=tuple(self.drives[key]),
            cameras=frozenset(),
            n_sightings=sum(one.n_sightings for one in mine),
            first_ns=min(one.first_ns for one in mine),
            last_ns=max(one.last_ns for one in mine),
            seen_from_deg=frozenset().union(*(directions.get(one.member, ()) for one in mine)),
        )


_AT_ONCE = 500
"""Ids in one statement: SQLite of some systems takes no more than 999 parameters."""
_AS_THEY_ARE = ("drive_id", "object", "east_m", "north_m", "n_sightings", "first_ns", "last_ns")
_OF_ESTIMATES = (*_AS_THEY_ARE, "skiltnummer", "cov_ee_m2", "cov_en_m2", "cov_nn_m2")


def _paired(
    poles: Sequence[ObservedPole],
    sites: Sequence[Site],
    taken: Collection[SiteId],
    p_unannotated: FloatArray,
    config: MatchConfig,
) -> dict[SiteId, _Pair]:
    """Pair poles that the match left out, since later drives missed them, with the sites that are left."""
    rows = [k for k, site in enumerate(sites) if (site.nvdb_type, site.nvdb_id) not in taken]
    left = [sites[k] for k in rows]
    found = assign(poles, left, p_unannotated[rows], config)
    return {
        (left[j].nvdb_type, left[j].nvdb_id): _Pair(poles[i].key, float(found.confidence_of_pole[i]))
        for i, j in enumerate(found.site_of_pole.tolist())
        if j >= 0
    }


_SURE = 0.9999
"""Findings state probabilities to four decimals: above this, the terms of the pair say more."""


def _odds(pairs: Sequence[_Pair], p_unannotated: FloatArray, config: MatchConfig) -> FloatArray:
    """Odds of pairs without what the match knew of presence, which the filter works out by time."""
    noticed = (1 - config.p_gone) * np.maximum(1 - p_unannotated, 0.5)
    alone = config.p_gone + (1 - config.p_gone) * p_unannotated
    p = np.array([min(pair.probability, 1 - 1e-9) for pair in pairs])
    odds = p / (1 - p) * alone / noticed
    by_terms = np.array([pair.log_odds for pair in pairs])
    surest = (p > _SURE) & np.isfinite(by_terms)
    return np.asarray(np.where(surest, np.exp(np.clip(by_terms, -50.0, 50.0)), odds))


@dataclass(frozen=True, slots=True)
class _Witness:
    """What drives say of sites, then of found poles.

    ``came``: days (ISO) from which a drive can have missed the place's sign. ``rows``: places that each drive
    saw, by drive.
    """

    came: NDArray[np.str_]
    rows: Mapping[str, Sequence[int]]
    n: int
    config: MatchConfig

    @classmethod
    def of(cls, sites: Sequence[Site], seen_in: Sequence[Mapping[str, int]], config: MatchConfig) -> _Witness:
        rows: dict[str, list[int]] = {}
        for k, drives in enumerate(seen_in):
            for drive_id in drives:
                rows.setdefault(drive_id, []).append(k)
        # Where NVDB has a sign only on the road's line, a drive cannot have missed it; nor what came later.
        came = [site.start_date if site.own_geometry else _NEVER for site in sites]
        return cls(np.array(came, dtype=np.str_), rows, len(seen_in), config)

    def says(self, drive: Drive, trusted: bool, fronts: IntArray, asked: Asked | None) -> Passed:
        """What one drive says; `fronts`: images in which it had the front of each site in view."""
        views, seen = np.zeros(self.n, dtype=np.int64), np.zeros(self.n, dtype=np.bool_)
        seen[list(self.rows.get(drive.drive_id, ()))] = True
        if trusted:
            started = dt.datetime.fromtimestamp(drive.started_ns // 1_000_000_000, tz=dt.UTC)
            views[: len(fronts)] = np.where(self.came <= started.date().isoformat(), fronts, 0)
            if asked is not None:
                views[len(fronts) :] = drive.watcher.past(asked).fronts
        rows = np.flatnonzero(seen | (views > 0))
        # Seen from where its place was not counted as in view: as well as any.
        well = trusted & (seen[rows] & (views[rows] == 0) | (views[rows] >= self.config.min_views))
        return Passed(
            started_ns=drive.started_ns,
            rows=rows,
            seen=seen[rows],
            counts=views[rows] > 0,
            p_seen=np.where(well, 1 - self.config.p_missed, 1 - self.config.p_unseen),
        )


_NEVER = "9999"
