"""The filter run over what drives saw of every place, and what that says of a sign's pole."""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from twin.belief.evidence import Evidence
from twin.belief.filter import Life, Places, life_in_register
from twin.belief.lifetimes import Lifetimes, sign_class

_NS_PER_YEAR = 365.25 * 86_400e9
_NEVER = 1e-12
"""A pole that is a site's cannot have been seen where the site's sign was gone; whether it is, is weighed."""


@dataclass(frozen=True, slots=True)
class Assumed:
    """What the belief assumes beside the settings of the last match.

    Attributes
    ----------
    put_up_per_year : float
        Share of places without their sign that get one again in a year.
    hidden_years : float
        What hides a sign from every drive stands for so long.
    closed_late_per_year : float
        Rate at which NVDB closes those signs that are gone and that it is slow about.
    share_late : float
        Share of these among what is gone and NVDB still lists.
    p_false : float
        Chance that a drive marks a sign of which NVDB knows nothing where none stands.
    p_found : float
        Probability that a sign stands where NVDB has none and a drive is to mark one, before any has passed.
    """

    put_up_per_year: float = 0.02
    hidden_years: float = 10.0
    closed_late_per_year: float = 0.1
    share_late: float = 0.5
    p_false: float = 0.001
    p_found: float = 0.5


def probabilities(
    evidence: Evidence, lifetimes: Lifetimes, assumed: Assumed, *, synced: dt.datetime, at: dt.datetime
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return of each place (n,) how probably its sign stands, can be seen too, and is the pole seen.

    The pole that is taken for a site's is the site's, or one of its own beside it, where the site then was
    never seen: each counts by how well it tells all that was seen and not, and by what the match says of
    their places and codes.
    """
    run = _Run(evidence, lifetimes, assumed, synced, at)
    n, n_sites = len(evidence.last_seen_ns), len(evidence.sites)
    is_site = np.arange(n) < n_sites
    every, none = np.ones(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    start = np.where(is_site, 1 - evidence.config.p_gone, assumed.p_found)
    paired = run.filtered(start, seen=every, listed=is_site)
    apart = run.filtered(start, seen=~is_site, listed=is_site)
    # A pole of its own stood when it was first passed; NVDB does not list it.
    itself = run.filtered(np.where(is_site, 1.0, start), seen=every, listed=none)
    log_odds = paired.log_evidence - apart.log_evidence - itself.log_evidence
    with np.errstate(divide="ignore"):
        log_odds[:n_sites] += np.log(evidence.pair_odds)
    log_odds[n_sites:] = np.inf
    p = 1 / (1 + np.exp(-np.clip(log_odds, -700.0, 700.0)))
    stands = p * paired.stands + (1 - p) * apart.stands
    return stands, p * paired.visible + (1 - p) * apart.visible, p


@dataclass(frozen=True, slots=True)
class _Run:
    """What every run of the filter shares."""

    evidence: Evidence
    lifetimes: Lifetimes
    assumed: Assumed
    synced: dt.datetime
    at: dt.datetime

    def filtered(self, stands: FloatArray, *, seen: BoolArray, listed: BoolArray) -> Places:
        """Run it over all passes.

        Parameters
        ----------
        stands : float64 (n,)
            Probability that the sign stands at the first pass.
        seen : bool (n,)
            Whether the pole taken for the place's is the place's.
        listed : bool (n,)
            Whether that NVDB lists the place says something.
        """
        config, assumed = self.evidence.config, self.assumed
        classes = [sign_class(codes) for codes in self.evidence.codes]
        names = sorted(set(classes))
        grown_over = config.p_hidden / assumed.hidden_years
        alone = [
            Life(self.lifetimes.per_year(name), assumed.put_up_per_year, grown_over, config.p_hidden)
            for name in names
        ]
        slow = {"closed_late": assumed.closed_late_per_year, "share_late": assumed.share_late}
        lives = [*(life_in_register(one, config.p_gone, **slow) for one in alone), *alone]
        number = {name: k for k, name in enumerate(names)}
        life = np.array([number[name] for name in classes], dtype=np.int64) + np.where(listed, 0, len(names))
        of_one, of_none = lives[0].start(1.0, assumed.share_late), lives[0].start(0.0, assumed.share_late)
        is_site = np.arange(life.size) < len(self.evidence.sites)
        places = Places(
            stands[:, None] * of_one + (1 - stands[:, None]) * of_none,
            lives,
            life,
            p_false=np.where(is_site, _NEVER, assumed.p_false),
            listed_until=_years(self.synced),
        )
        for one in self.evidence.passes:
            was_seen = one.seen & seen[one.rows]
            says = was_seen | one.counts
            rows = one.rows[says]
            places.wait(rows, one.started_ns / _NS_PER_YEAR)
            places.measure(rows, was_seen[says], one.p_seen[says])
        places.wait(np.arange(life.size), _years(self.at))
        return places


def _years(moment: dt.datetime) -> float:
    return moment.timestamp() * 1e9 / _NS_PER_YEAR
