"""The filter against brute force: integrals over every time at which a sign can have gone or come."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from twin.belief.filter import Places, Rates, closing_rate, entropy_bits, settled_bits

Array = NDArray[np.float64]


@dataclass(frozen=True)
class World:
    """One place, and the passes of drives: when, seen or not, and how sure a drive is to see it."""

    passes: Sequence[tuple[float, bool, float]]
    now: float
    stands: float = 0.9
    down: float = 0.2
    up: float = 0.0
    over: float = 0.0
    closed: float = 0.0
    listed_until: float = 0.0
    p_hidden: float = 0.0
    p_false: float = 0.01

    def filtered(self) -> tuple[float, float]:
        """Probability that it stands now, and log evidence, by the filter."""
        rates = Rates(*(np.array([rate]) for rate in (self.down, self.up, self.over, self.closed)))
        place = Places(
            np.array([self.stands]),
            rates,
            p_hidden=self.p_hidden,
            p_false=np.array([self.p_false]),
            listed_until=self.listed_until,
        )
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


PASSES = [(0.0, True, 0.9), (0.3, False, 0.8), (1.1, False, 0.95), (2.5, True, 0.7), (4.0, False, 0.5)]


def middle(end: float, n: int) -> tuple[Array, float]:
    """Midpoints of n equal steps from 0, and their length."""
    step = end / n
    return (np.arange(n) + 0.5) * step, step


@pytest.mark.parametrize("n_passes", range(len(PASSES) + 1))
def test_what_is_never_put_up_again_is_rosens_integral(n_passes: int) -> None:
    """P(stands) is the integral of prior times likelihood over the times of vanishing that lie ahead."""
    world = World(PASSES[:n_passes], now=5.0 if n_passes else 0.0)
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
    world = World(passes, now=3.0, stands=0.1, down=0.0, up=0.4)
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
    world = World(PASSES, now=5.0, closed=1.3, listed_until=4.5)
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
    st.floats(0.0, 0.5),
    st.floats(0.0, 0.5),
    st.floats(0.0, 0.3),
    st.floats(0.0, 1.5),
)
def test_what_comes_and_goes_is_the_sum_over_all_lives(
    steps: list[tuple[float, bool, float]], stands: float, down: float, up: float, over: float, closed: float
) -> None:
    """Lives in small steps, hidden ones too: probabilities of every state, pass by pass."""
    times = np.cumsum([0.0] + [step for step, *_ in steps])
    passes = [(float(t), *rest) for t, (_, *rest) in zip(times[:-1], steps, strict=True)]
    now, listed_until = float(times[-1]), float(times[-1]) * 0.6
    world = World(passes, now, stands, down, up, over, closed, listed_until, p_hidden=0.05)
    # Visible, hidden, gone; second-order steps of the generator.
    generator = np.array(
        [[-down - over, 0.0, 0.95 * up], [over, -down, 0.05 * up], [down, down, -up]], dtype=np.float64
    )
    closing = generator - np.diag([0.0, 0.0, closed])
    state, at = np.array([0.95 * stands, 0.05 * stands, 1 - stands]), 0.0

    def drift(state: Array, years: float, by: Array) -> Array:
        n = 4000
        step = np.eye(3) + by * (years / n) + by @ by * (years / n) ** 2 / 2
        return np.asarray(np.linalg.matrix_power(step, n) @ state)

    for when, seen, p_seen in [*passes, (now, False, None)]:
        listed = max(0.0, min(when, listed_until) - at)
        state = drift(drift(state, listed, closing), when - at - listed, generator)
        at = when
        if p_seen is not None:
            there, away = (p_seen, 0.01) if seen else (1 - p_seen, 0.99)
            state = state * np.array([there, away, away])
    p, log_evidence = world.filtered()
    assert p == pytest.approx(state[:2].sum() / state.sum(), abs=1e-6)
    assert log_evidence == pytest.approx(np.log(state.sum()), abs=1e-5)


def test_a_listed_place_that_nobody_passes_stays_as_sure_as_the_register() -> None:
    """`closing_rate` is the rate at which the share of signs gone holds."""
    down, up = np.array([0.02, 0.1]), np.array([0.02, 0.01])
    rates = Rates(down, up, np.zeros(2), closing_rate(down, up, 0.02))
    place = Places(np.array([0.98, 0.98]), rates, p_hidden=0.0, p_false=np.full(2, 0.01), listed_until=30.0)
    rows = np.arange(2)
    place.wait(rows, 0.0)
    place.wait(rows, 30.0)
    np.testing.assert_allclose(place.stands, 0.98, atol=1e-9)
    place.wait(rows, 31.0)
    assert (place.stands < 0.98).all()


def test_settled_bits_is_the_mean_over_what_a_drive_may_see() -> None:
    """Against the filter itself: entropy before, less its mean after a pass."""
    start = np.array([0.5, 0.98, 0.02, 1.0])
    rates = Rates(*(np.zeros(4) for _ in range(4)))
    rows, detection = np.arange(4), 0.9
    after = {}
    for seen in (True, False):
        place = Places(start, rates, p_hidden=0.1, p_false=np.full(4, 0.01), listed_until=0.0)
        visible = place.visible
        place.measure(rows, np.full(4, seen), np.full(4, detection))
        after[seen] = np.exp(place.log_evidence), entropy_bits(place.stands)
    expected = entropy_bits(start) - sum(p * bits for p, bits in after.values())
    np.testing.assert_allclose(settled_bits(visible, start, detection, 0.01), expected, atol=1e-9)
    assert settled_bits(visible, start, detection, 0.01)[0] > 0.5
