"""Which places are listed, and the documents that ``twin belief --json`` prints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from twin.belief.belief import Belief, Believed
from twin.belief.lifetimes import Lifetimes
from twin.belief.roads import RoadToDrive, is_on_a_road, roads_to_drive
from twin.belief.state import State


@dataclass(frozen=True, slots=True)
class Chosen:
    """Which places are asked for: those that fit every criterion.

    Attributes
    ----------
    road : str
        Beginning of a road reference, ``FV6680`` or ``FV6680 S1D1``; "" for every.
    kommuner : tuple of int
    states : tuple of State
    p_stands : (float, float)
        Least and most.
    """

    road: str = ""
    kommuner: tuple[int, ...] = ()
    states: tuple[State, ...] = ()
    p_stands: tuple[float, float] = (0.0, 1.0)

    def of(self, places: Iterable[Believed]) -> tuple[Believed, ...]:
        """Return them, the least sure first."""
        found = [one for one in places if self._fits(one)]
        return tuple(sorted(found, key=lambda one: (-one.unsure_bits, one.place_id)))

    def _fits(self, one: Believed) -> bool:
        least, most = self.p_stands
        return (
            least <= one.p_stands <= most
            and (not self.states or one.state in self.states)
            and (not self.kommuner or bool(set(map(str, self.kommuner)) & set(one.kommune.split(","))))
            and f"{one.road} ".casefold().startswith(f"{self.road} ".casefold() if self.road else "")
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class BeliefList:
    """What is believed of the places that were asked for.

    Attributes
    ----------
    at : str
        The moment that it is of, UTC.
    total : int
        Places that were asked for, of which `places` may be the first.
    states : mapping of State to int
        How many of them are in each.
    places : tuple of Believed
        The least sure first.
    lifetimes : Lifetimes
        How soon signs are taken down, by class.
    """

    at: str
    total: int
    states: Mapping[str, int]
    places: tuple[Believed, ...]
    lifetimes: Lifetimes

    @classmethod
    def of(cls, belief: Belief, places: tuple[Believed, ...], limit: int | None) -> BeliefList:
        """Make it of a belief and the places chosen from it."""
        counted = Counter(one.state for one in places)
        return cls(
            at=f"{belief.at:%Y-%m-%dT%H:%M:%SZ}",
            total=len(places),
            states={state.value: counted[state] for state in State},
            places=places[:limit],
            lifetimes=belief.lifetimes,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadList:
    """Roads by what one more drive along them is expected to settle.

    Attributes
    ----------
    at : str
        The moment that it is of, UTC.
    total : int
        Roads on which places stand that were asked for, of which `roads` may be the first.
    n_off_road : int
        Places that were asked for and have no road reference.
    detection : float
        Chance that a drive sees a sign which stands and is not hidden.
    roads : tuple of RoadToDrive
        Most bits a kilometre first.
    lifetimes : Lifetimes
        How soon signs are taken down, by class.
    """

    at: str
    total: int
    n_off_road: int
    detection: float
    roads: tuple[RoadToDrive, ...]
    lifetimes: Lifetimes

    @classmethod
    def of(
        cls, belief: Belief, places: tuple[Believed, ...], limit: int | None, detection: float | None = None
    ) -> RoadList:
        """Make it of a belief and the places chosen from it; `detection` by default that of the belief."""
        p_seen = belief.p_seen if detection is None else detection
        roads = roads_to_drive(places, p_seen=p_seen)
        return cls(
            at=f"{belief.at:%Y-%m-%dT%H:%M:%SZ}",
            total=len(roads),
            n_off_road=sum(not is_on_a_road(one) for one in places),
            detection=p_seen,
            roads=roads[:limit],
            lifetimes=belief.lifetimes,
        )
