"""For each place the probability that a sign stands there now: the filter over what all drives saw."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33
from nvdb.datakatalog import SKILTPUNKT
from twin.belief.evidence import Evidence, evidence_of
from twin.belief.filter import entropy_bits
from twin.belief.lifetimes import Lifetimes, lifetimes_of
from twin.belief.model import Assumed, probabilities
from twin.belief.state import State
from twin.errors import ConfigError
from twin.matching.verdicts.finding import utc_time
from twin.mirror.roads import roads_of
from twin.store.store import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Believed:
    """What is believed of one place, as tables and maps have it; None where something is not known.

    Attributes
    ----------
    place_id : str
        ``95:NVDB id``, or the key of a pole that drives found and NVDB does not have.
    skiltnummer : str
        Codes of its plates in NVDB, else as seen, joined by ;.
    p_stands : float
        Probability that the sign stands at the moment that was asked for.
    unsure_bits : float
        Entropy of that: 1 at a half, 0 at certainty.
    state : str
        A :class:`State`.
    last_seen, last_passed : str or None
        When a drive last saw it; when one last passed that says something of it. UTC.
    n_seen, n_missed : int
        Drives that saw it; completely annotated ones that had it in view and did not.
    verdict : str or None
        Of the last match; None where it says nothing.
    road, kommune : str
        Vegsystemreferanse; kommune numbers are parted by commas.
    east_m, north_m : float
        EPSG:25833.
    longitude_deg, latitude_deg : float
        WGS84.
    p_visible : float
        Probability that it stands and is not hidden from every drive.
    """

    place_id: str
    nvdb_type: int | None
    nvdb_id: int | None
    skiltnummer: str
    p_stands: float
    unsure_bits: float
    state: str
    last_seen: str | None
    last_passed: str | None
    n_seen: int
    n_missed: int
    verdict: str | None
    road: str
    kommune: str
    east_m: float
    north_m: float
    longitude_deg: float
    latitude_deg: float
    p_visible: float


@dataclass(frozen=True, slots=True)
class Belief:
    """What is believed of every place.

    Attributes
    ----------
    at : datetime
        The moment, UTC.
    places : tuple of Believed
        NVDB's signs by id, then what drives found.
    lifetimes : Lifetimes
        By which signs are taken down, and what they rest on.
    p_seen : float
        Chance that a completely annotated drive sees a sign which stands and is not hidden.
    """

    at: dt.datetime
    places: tuple[Believed, ...]
    lifetimes: Lifetimes
    p_seen: float


def believe(
    store: Store, *, at: dt.datetime | None = None, today: bool = False, assumed: Assumed | None = None
) -> Belief:
    """Work out what is believed of every place of a store; nothing is kept, so nothing can be out of date.

    Parameters
    ----------
    store : Store
        Matched, and not changed since; may be read-only.
    at : datetime, optional
        With a time zone. By default that of the newest drive or sync: the same store gives the same.
    today : bool
        Now, where `at` is not given; not before the newest drive or sync.
    assumed : Assumed, optional

    Raises
    ------
    StoreError
        Nothing was matched yet.
    RefusedError
        Drives or mirror have changed since.
    ConfigError
        `at` lies before the newest drive or sync.
    """
    assumed = assumed or Assumed()
    evidence = evidence_of(store)
    with store.snapshot() as view:
        lifetimes = lifetimes_of(view, evidence.config.removed_per_year)
        read_at = dt.datetime.fromisoformat((view.fact("mirror") or {})["synced_at"])
    # By days, as NVDB dates its signs: a second sync of the day changes no figure.
    synced = read_at.replace(hour=0, minute=0, second=0)
    newest = max([synced, *(_utc(one.started_ns) for one in evidence.passes)])
    if at is None:
        at = max(newest, dt.datetime.now(dt.UTC)) if today else newest
    if at < newest:
        raise ConfigError(
            f"The store {store.name} knows of {newest:%Y-%m-%dT%H:%M:%SZ}: ask for a moment from then on."
        )
    stands, visible, p_pair = probabilities(evidence, lifetimes, assumed, synced=synced, at=at)
    places = tuple(_told(store, evidence, stands, visible, p_pair))
    return Belief(at, places, lifetimes, 1 - evidence.config.p_missed)


class _Placed(NamedTuple):
    """As :func:`twin.mirror.roads.roads_of` wants it."""

    change_id: str
    nvdb_type: int
    nvdb_id: int | None
    east_m: float
    north_m: float


def _told(
    store: Store, evidence: Evidence, stands: FloatArray, visible: FloatArray, p_pair: FloatArray
) -> Iterator[Believed]:
    n = len(stands)
    n_seen, n_missed, last_ns = (np.zeros(n, dtype=np.int64) for _ in range(3))
    for one in evidence.passes:
        # A pole that is more likely another's was not seen here.
        seen = one.seen & (p_pair[one.rows] >= 0.5)
        says = seen | one.counts
        n_seen[one.rows[seen]] += 1
        n_missed[one.rows[says & ~seen]] += 1
        last_ns[one.rows[says]] = one.started_ns
    last_ns = np.where(n_seen > 0, np.maximum(last_ns, evidence.last_seen_ns), last_ns)
    placed = [
        _Placed(f"{s.nvdb_type}:{s.nvdb_id}", s.nvdb_type, s.nvdb_id, s.east_m, s.north_m)
        for s in evidence.sites
    ]
    placed += [_Placed(pole.key, SKILTPUNKT, None, pole.east_m, pole.north_m) for pole in evidence.found]
    roads = roads_of(store, placed, streets=False)
    at = np.array([(one.east_m, one.north_m) for one in placed]).reshape(-1, 2)
    latitude, longitude = geographic_from_utm33(*at.T)
    bits, codes = entropy_bits(stands), evidence.codes
    for k, place in enumerate(placed):
        road, nvdb_id = roads[place.change_id], place.nvdb_id
        verdict = evidence.verdicts.get(place.change_id if nvdb_id is None else (place.nvdb_type, nvdb_id))
        yield Believed(
            place_id=place.change_id,
            nvdb_type=None if nvdb_id is None else place.nvdb_type,
            nvdb_id=nvdb_id,
            skiltnummer=";".join(codes[k]),
            p_stands=round(float(stands[k]), 6),
            unsure_bits=round(float(bits[k]), 6),
            state=State.of(float(stands[k]), passed=bool(last_ns[k])).value,
            last_seen=utc_time(int(evidence.last_seen_ns[k])) if n_seen[k] else None,
            last_passed=utc_time(int(last_ns[k])) if last_ns[k] else None,
            n_seen=int(n_seen[k]),
            n_missed=int(n_missed[k]),
            verdict=None if verdict is None else verdict.value,
            road=road.reference,
            kommune=",".join(map(str, road.kommuner)),
            east_m=round(place.east_m, 3),
            north_m=round(place.north_m, 3),
            longitude_deg=round(float(longitude[k]), 7),
            latitude_deg=round(float(latitude[k]), 7),
            p_visible=round(float(visible[k]), 6),
        )


def _utc(epoch_ns: int) -> dt.datetime:
    return dt.datetime.fromtimestamp(int(epoch_ns) // 1_000_000_000, tz=dt.UTC)
