"""The filter against brute force: integrals over every time at which a sign can have gone or come."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from belief import binned, simulate
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from twin.belief.filter import Life, Places, entropy_bits, life_in_register, settled_bits
from twin.matching.absence import _p_taken_down
from twin.matching.config import MatchConfig
from twin.matching.poles.poles import ObservedPole

Array = NDArray[np.float64]


@dataclass(frozen=True)
class World:
    """One place, and the passes of drives: when, seen or not, and how sure a drive is to see it."""

    passes: Sequence[tuple[float, bool, float]]
    now: float
    life: Life
    stands: float = 0.9
    listed_until: float = 0.0
    p_false: float = 0.01

    def filtered(self) -> tuple[float, float]:
        """Probability that it stands now, and log evidence, by the filter."""
        place = one_place(self.life.start(self.stands), self.life, self.p_false, self.listed_until)
        rows = np.zeros(1, dtype=np.int64)
        for when, seen, p_seen in self.passes:
            place.wait(rows, when)
            place.measure(rows, np.array([seen]), np.array([p_seen]))
        place.wait(rows, self.now)
        return float(place.stands[0]), float(place.log_evidence[0])

    def likelihood(self, stands_at: Callable[[float], Array]) -> Array:
        """Of all passes, for any number of lives of the sign at once."""
        whole = np.ones_like(stands_at(0.0), dtype=np.float64)
        for when, seen, p_seen in self.passes:
            there, away = (p_seen, self.p_false) if seen else (1 - p_seen, 1 - self.p_false)
            whole *= np.where(stands_at(when), there, away)
        return whole


def one_place(
    start: Array, life: Life, p_false: float = 0.01, listed_until: float = 0.0, n: int = 1
) -> Places:
    """Places that all begin alike."""
    every = np.zeros(n, dtype=np.int64)
    states = np.tile(start, (n, 1))
    return Places(states, [life], every, p_false=np.full(n, p_false), listed_until=listed_until)


PASSES = [(0.0, True, 0.9), (0.3, False, 0.8), (1.1, False, 0.95), (2.5, True, 0.7), (4.0, False, 0.5)]


def middle(end: float, n: int) -> tuple[Array, float]:
    """Midpoints of n equal steps from 0, and their length."""
    step = end / n
    return (np.arange(n) + 0.5) * step, step


@pytest.mark.parametrize("n_passes", range(len(PASSES) + 1))
def test_what_is_never_put_up_again_is_rosens_integral(n_passes: int) -> None:
    """P(stands) is the integral of prior times likelihood over the times of vanishing that lie ahead."""
    world = World(PASSES[:n_passes], 5.0 if n_passes else 0.0, Life(0.2))
    gone_at, step = middle(5.0, 500_000)
    weight = world.stands * 0.2 * np.exp(-0.2 * gone_at) * world.likelihood(lambda t: gone_at > t)
    before = float(weight.sum() * step) if n_passes else 0.0
    later = np.exp(-0.2 * 5.0) if n_passes else 1.0
    stands = world.stands * later * float(world.likelihood(lambda _: np.array(True)))
    never = (1 - world.stands) * float(world.likelihood(lambda _: np.array(False)))
    p, log_evidence = world.filtered()
    assert p == pytest.approx(stands / (stands + before + never), abs=1e-5)
    assert log_evidence == pytest.approx(np.log(stands + before + never), abs=1e-4)


def test_what_is_never_taken_down_is_the_emergence_integral() -> None:
    """Without `down` it is the same over the times of coming."""
    passes = [(0.0, False, 0.9), (1.0, False, 0.9), (2.0, True, 0.9)]
    world = World(passes, 3.0, Life(0.0, 0.4), stands=0.1)
    came_at, step = middle(3.0, 300_000)
    weight = 0.9 * 0.4 * np.exp(-0.4 * came_at) * world.likelihood(lambda t: came_at < t)
    came = float(weight.sum() * step)
    always = 0.1 * float(world.likelihood(lambda _: np.array(True)))
    never = 0.9 * np.exp(-0.4 * 3.0) * float(world.likelihood(lambda _: np.array(False)))
    p, log_evidence = world.filtered()
    assert p == pytest.approx((came + always) / (came + always + never), abs=1e-5)
    assert log_evidence == pytest.approx(np.log(came + always + never), abs=1e-4)


def test_a_register_that_still_lists_a_sign_speaks_for_it() -> None:
    """The same integral with the chance that what had gone was not closed until the last sync."""
    world = World(PASSES, 5.0, Life(0.2, closed=1.3), listed_until=4.5)
    gone_at, step = middle(5.0, 500_000)
    listed = np.exp(-1.3 * np.maximum(4.5 - gone_at, 0.0))
    weight = world.stands * 0.2 * np.exp(-0.2 * gone_at) * world.likelihood(lambda t: gone_at > t) * listed
    before = float(weight.sum() * step)
    stands = world.stands * np.exp(-0.2 * 5.0) * float(world.likelihood(lambda _: np.array(True)))
    never = (1 - world.stands) * np.exp(-1.3 * 4.5) * float(world.likelihood(lambda _: np.array(False)))
    assert world.filtered()[0] == pytest.approx(stands / (stands + before + never), abs=1e-5)


@given(
    st.lists(st.tuples(st.floats(0.02, 1.5), st.booleans(), st.floats(0.3, 0.99)), min_size=1, max_size=6),
    st.floats(0.05, 0.95),
    st.lists(st.floats(0.0, 0.5), min_size=5, max_size=5),
)
def test_what_comes_and_goes_is_the_sum_over_all_lives(
    steps: list[tuple[float, bool, float]], stands: float, rates: list[float]
) -> None:
    """Lives of every kind in four thousand small steps, pass by pass."""
    down, up, over, closed, late = rates
    life = Life(down, up, over, p_hidden=0.05, closed=3 * closed, closed_late=0.1, late=late)
    times = np.cumsum([0.0] + [step for step, *_ in steps])
    passes = [(float(t), *rest) for t, (_, *rest) in zip(times[:-1], steps, strict=True)]
    world = World(passes, float(times[-1]), life, stands, listed_until=float(times[-1]) * 0.6)
    visible, hidden, gone, slow, at = 0.95 * stands, 0.05 * stands, 1 - stands, 0.0, 0.0
    for when, seen, p_seen in [*passes, (world.now, False, None)]:
        n = 4000
        dt = (when - at) / n
        for k in range(n if dt else 0):
            listed = at + k * dt < world.listed_until
            fall, rise = down * (visible + hidden) * dt, up * (gone + slow) * dt
            grow = over * visible * dt
            kept = 1 - down * dt
            end, end_slow = (1 - (up + closes * listed) * dt for closes in (3 * closed, 0.1))
            visible, hidden = visible * kept - grow + 0.95 * rise, hidden * kept + grow + 0.05 * rise
            gone, slow = gone * end + (1 - late) * fall, slow * end_slow + late * fall
        at = when
        if p_seen is not None:
            there, away = (p_seen, 0.01) if seen else (1 - p_seen, 0.99)
            visible, hidden, gone, slow = visible * there, hidden * away, gone * away, slow * away
    total = visible + hidden + gone + slow
    p, log_evidence = world.filtered()
    assert p == pytest.approx((visible + hidden) / total, abs=2e-3)
    assert log_evidence == pytest.approx(np.log(total), abs=2e-3)


@pytest.mark.parametrize("down", [0.005, 0.02, 0.3])
def test_a_listed_place_that_nobody_passes_stays_as_sure_as_the_register(down: float) -> None:
    """`life_in_register` gives the rates at which the share of signs gone holds; unlisted it grows."""
    life = life_in_register(Life(down, 0.02, 1e-4, 0.001), 0.02, closed_late=0.1, share_late=0.5)
    place = one_place(life.start(0.98, 0.5), life, listed_until=30.0, n=2)
    rows = np.arange(2)
    for when in (0.0, 30.0):
        place.wait(rows, when)
        np.testing.assert_allclose(place.stands, 0.98, atol=1e-9)
    place.wait(rows, 31.0)
    assert (place.stands < 0.98).all()


def test_settled_bits_is_the_mean_over_what_a_drive_may_see() -> None:
    """Against the filter itself: entropy before, less its mean after a pass."""
    life, rows, detection = Life(0.0, p_hidden=0.1), np.arange(1), 0.9
    for start in (0.5, 0.98, 0.02):
        after = 0.0
        for seen in (True, False):
            place = one_place(life.start(start), life)
            visible = place.visible
            place.measure(rows, np.array([seen]), np.array([detection]))
            after += float(np.exp(place.log_evidence[0]) * entropy_bits(place.stands)[0])
        expected = float(entropy_bits(start)) - after
        assert settled_bits(visible, np.array([start]), detection, 0.01)[0] == pytest.approx(expected)
        assert expected > 0.01


def test_stated_probabilities_come_true() -> None:
    """Of simulated signs that vanish and come back as many stand as the filter says, in every bin."""
    bins = [one for one in binned(simulate(40_000, 6.0, np.random.default_rng(7))) if one.n >= 50]
    assert len(bins) >= 7
    assert max(one.standard_errors for one in bins) < 4
    # And the test can tell: were four times as many taken down, hardly any bin would hold.
    wrong = binned(simulate(40_000, 6.0, np.random.default_rng(7), removed=4.0))
    assert sum(one.standard_errors > 4 for one in wrong) > len(wrong) / 2


@given(st.floats(0.001, 3.0))
def test_match_believes_the_same_of_a_pole_that_one_drive_missed(years: float) -> None:
    """`match` doubts a pole by the same filter, for one that is never put up again and may be hidden."""
    config = MatchConfig()
    pole = ObservedPole(("d:1",), "d:1", 0.0, 0.0, np.eye(2), (), ("d",), frozenset(), 1, last_ns=10**18)
    life = Life(config.removed_per_year, p_hidden=config.p_hidden)
    place, row = one_place(life.start(1.0), life, p_false=1e-12), np.zeros(1, dtype=np.int64)
    place.wait(row, 0.0)
    place.wait(row, years)
    place.measure(row, np.array([False]), np.array([1 - config.p_missed]))
    passed = [10**18 + round(years * 365.25 * 86_400e9)]
    assert _p_taken_down(pole, passed, config) == pytest.approx(1 - place.stands[0], abs=1e-9)
