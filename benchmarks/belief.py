"""Is the stated probability that a sign stands true? Signs that vanish and come back, passed by drives.

Usage: python benchmarks/belief.py [--signs 200000] [--years 6] [--out docs/images/belief.png]
       python benchmarks/belief.py --store FILE

Signs are taken down, put up, grown over and closed by NVDB at the rates that the filter is given, drives pass
them at random times and overlook some. Of what NVDB still lists at its last sync, the probability that the
filter states a while later is held against whether the sign stands. `--removed 4` takes down four times as
many signs as the filter believes.

Bar: in every bin with 50 signs or more the stated probability lies within four standard errors of the share
that stands, where rates are as believed.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from twin.belief import believe
from twin.belief.filter import GONE, GONE_LATE, HIDDEN, VISIBLE, Life, Places, life_in_register
from twin.cli.output import print_table
from twin.figures import png
from twin.store.store import Store

Array = NDArray[np.float64]
EDGES = (0.0, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.98, 0.99, 0.995, 1.0)
P_GONE, P_HIDDEN, P_MISSED, P_FALSE, P_UNSEEN = 0.02, 0.001, 0.002, 1e-12, 0.5
CLOSED, SHARE_LATE = 4, 0.5
DOWN = (0.01, 0.03, 0.15)
LIVES = [
    life_in_register(Life(down, 0.05, 1e-4, P_HIDDEN), P_GONE, closed_late=0.1, share_late=SHARE_LATE)
    for down in DOWN
]


@dataclass(frozen=True)
class Outcome:
    """Of the signs that NVDB lists: the stated probability, and whether each stands."""

    stated: Array
    stands: NDArray[np.bool_]


@dataclass(frozen=True)
class Bin:
    """Signs of like stated probability."""

    low: float
    high: float
    n: int
    stated: float
    true: float

    @property
    def standard_errors(self) -> float:
        """How far the share that stands lies from what was stated."""
        spread = np.sqrt(max(self.stated * (1 - self.stated), 1e-9) / self.n)
        return float(abs(self.stated - self.true) / spread)


def simulate(n: int, years: float, draw: np.random.Generator, *, removed: float = 1.0) -> Outcome:
    """Draw the lives of signs and the passes of drives, and run the filter over what drives saw."""
    # Three classes of signs, each with its own life.
    life = draw.integers(0, len(DOWN), n)
    late = draw.random(n) < SHARE_LATE
    gone = np.where(late, GONE_LATE, GONE)
    state = np.where(draw.random(n) < P_GONE, gone, np.where(draw.random(n) < P_HIDDEN, HIDDEN, VISIBLE))
    start = LIVES[0].start(1 - P_GONE, SHARE_LATE)
    places = Places(
        np.tile(start, (n, 1)), LIVES, life, p_false=np.full(n, P_FALSE), listed_until=years - 0.5
    )
    real = Jumps([replace(one, down=removed * one.down) for one in LIVES], life, years - 0.5, draw)
    # The first drive passes all: what the filter assumes holds then.
    for drive, when in enumerate(np.concatenate([[0.0], np.sort(draw.uniform(0.0, years - 0.2, 30))])):
        state = real.later(state, float(when))
        rows = np.flatnonzero(draw.random(n) < (1.0 if drive == 0 else 0.15))
        p_seen = draw.choice([1 - P_MISSED, 1 - P_UNSEEN], rows.size, p=[0.8, 0.2])
        seen = (state[rows] == VISIBLE) & (draw.random(rows.size) < p_seen)
        places.wait(rows, float(when))
        places.measure(rows, seen, p_seen)
    state = real.later(state, years)
    places.wait(np.arange(n), years)
    listed = state != CLOSED
    return Outcome(places.stands[listed], state[listed] <= HIDDEN)


class Jumps:
    """Signs that jump from state to state, each at its own random instants."""

    def __init__(
        self,
        lives: list[Life],
        life: NDArray[np.int64],
        listed_until: float,
        draw: np.random.Generator,
    ) -> None:
        names = ("down", "up", "grown_over", "p_hidden", "closed", "closed_late", "late")
        self._of = {name: np.array([getattr(one, name) for one in lives])[life] for name in names}
        self._now, self._listed_until, self._draw = 0.0, listed_until, draw

    def later(self, state: NDArray[np.int64], until: float) -> NDArray[np.int64]:
        """States after a while."""
        state = state.copy()
        for end, closes in ((min(until, self._listed_until), True), (until, False)):
            at = np.full(state.size, self._now)
            going = np.flatnonzero((at < end) & (state != CLOSED))
            while going.size:
                first, other, to_first, to_other = self._rates(state[going], going, closes=closes)
                at[going] += self._draw.exponential(1 / (first + other))
                jumps = at[going] < end
                to = np.where(self._draw.random(going.size) < first / (first + other), to_first, to_other)
                state[going[jumps]] = to[jumps]
                going = going[jumps & (to != CLOSED)]
            self._now = max(self._now, end)
        return state

    def _rates(self, state: NDArray[np.int64], rows: NDArray[np.int64], *, closes: bool) -> tuple[Array, ...]:
        """Rates of being taken down or put up, and of anything else; where each leads to."""
        of = {name: values[rows] for name, values in self._of.items()}
        is_gone = state >= GONE
        ends = np.where(state == GONE_LATE, of["closed_late"], of["closed"]) * closes
        over = np.where(state == VISIBLE, of["grown_over"], 0.0)
        down = np.where(self._draw.random(rows.size) < of["late"], GONE_LATE, GONE)
        up = np.where(self._draw.random(rows.size) < of["p_hidden"], HIDDEN, VISIBLE)
        return (
            np.where(is_gone, of["up"], of["down"]),
            np.where(is_gone, ends, over),
            np.where(is_gone, up, down),
            np.where(is_gone, CLOSED, HIDDEN),
        )


def binned(outcome: Outcome) -> list[Bin]:
    """Bins of stated probability that hold any sign."""
    number = np.clip(np.searchsorted(EDGES, outcome.stated, side="right") - 1, 0, len(EDGES) - 2)
    bins = []
    for k in np.unique(number).tolist():
        mine = number == k
        stated, true = float(outcome.stated[mine].mean()), float(outcome.stands[mine].mean())
        bins.append(Bin(EDGES[k], EDGES[k + 1], int(mine.sum()), stated, true))
    return bins


def one_sign() -> tuple[Array, Array, list[tuple[float, bool]]]:
    """The belief in one sign over four years: seen twice, missed three times, seen again."""
    passes = [(0.2, True), (1.1, True), (1.6, False), (1.7, False), (2.6, False), (3.2, True)]
    times = np.linspace(0.0, 4.0, 801)
    life = life_in_register(Life(0.02, 0.02, 1e-4, P_HIDDEN), P_GONE, closed_late=0.1, share_late=SHARE_LATE)
    place = Places(
        life.start(1 - P_GONE, SHARE_LATE)[None],
        [life],
        np.zeros(1, dtype=np.int64),
        p_false=np.array([P_FALSE]),
        listed_until=4.0,
    )
    row, stands, left = np.zeros(1, dtype=np.int64), [], list(passes)
    for now in times.tolist():
        while left and left[0][0] <= now:
            when, seen = left.pop(0)
            place.wait(row, when)
            place.measure(row, np.array([seen]), np.array([1 - P_MISSED]))
        place.wait(row, now)
        stands.append(float(place.stands[0]))
    return times, np.array(stands), passes


def draw(bins: list[Bin], path: Path) -> None:
    """Draw one sign's belief over time, and stated against true probabilities."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.2), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2)
    times, stands, passes = one_sign()
    left.plot(times, stands, color="#33516e", linewidth=2)
    for seen, mark, colour, name in ((True, "o", "#009e73", "seen"), (False, "X", "#d55e00", "not seen")):
        at = [when for when, was in passes if was is seen]
        left.plot(
            at, [1.06] * len(at), mark, color=colour, markeredgecolor="black", label=name, clip_on=False
        )
    left.set(xlabel="years", ylabel="probability that it stands", ylim=(-0.02, 1.12), xlim=(0, 4))
    left.set_title("One sign: six complete drives past it", fontsize=10)
    left.legend(loc="lower right", fontsize=9)
    x = np.arange(len(bins))
    for k, one in enumerate(bins):
        right.plot([k - 0.35, k + 0.35], [one.stated, one.stated], color="black", linewidth=2)
        spread = 1.96 * np.sqrt(one.true * (1 - one.true) / one.n)
        right.plot([k, k], [one.true - spread, one.true + spread], color="#0072b2", linewidth=2)
        right.plot([k], [one.true], "o", color="#0072b2", markeredgecolor="black")
        right.annotate(f"{one.n:,}", (k, 1.05), ha="center", fontsize=7)
    right.set_xticks(x, [f"{one.low:g}-{one.high:g}" for one in bins], rotation=45, ha="right", fontsize=8)
    right.set(xlabel="stated", ylabel="share that stands (bar: stated)", ylim=(-0.02, 1.12))
    right.set_title("Simulated signs that vanish and come back", fontsize=10)
    for ax in (left, right):
        ax.grid(axis="y", color="0.9")
        ax.set_axisbelow(True)
    path.write_bytes(png(figure))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--signs", type=int, default=200_000)
    parser.add_argument("--years", type=float, default=6.0)
    parser.add_argument("--removed", type=float, default=1.0, help="signs taken down, times what is believed")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--store", type=Path, help="a matched store: how long its belief takes")
    parser.add_argument("--out", type=Path, help="PNG of the picture in docs/belief.md")
    options = parser.parse_args()
    if options.store is not None:
        start = time.process_time()
        with Store(options.store) as store:
            n = len(believe(store).places)
        print(f"{n:,} places: {time.process_time() - start:.1f} s of the processor")
        return
    outcome = simulate(
        options.signs, options.years, np.random.default_rng(options.seed), removed=options.removed
    )
    bins = binned(outcome)
    rows = [
        (f"{one.low:g} to {one.high:g}", one.n, f"{one.stated:.2%}", f"{one.true:.2%}", one.standard_errors)
        for one in bins
    ]
    print_table("Stated and true", ["stated", "signs", "mean stated", "stand", "standard errors"], rows)
    off = sum(one.n * abs(one.stated - one.true) for one in bins) / len(outcome.stated)
    brier = float(np.mean((outcome.stated - outcome.stands) ** 2))
    print(f"expected calibration error {off:.3%}, Brier score {brier:.5f}")
    if options.out is not None:
        draw(bins, options.out)
    worst = max((one.standard_errors for one in bins if one.n >= 50), default=0.0)
    if options.removed == 1.0:
        print(f"bar: worst bin {worst:.1f} standard errors, 4 allowed: {'ok' if worst <= 4 else 'MISSED'}")


if __name__ == "__main__":
    main()
