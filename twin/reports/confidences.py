"""What people's decisions say of the confidences: whether findings of 90 % are right nine times in ten."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from twin.decisions.log import DECIDED, UNDONE, Entry
from twin.matching.config import MatchConfig
from twin.store import schema
from twin.store.kinds import Decision, Verdict
from twin.store.store import Store
from twin.words.reasons import Temporary

EDGES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.0)
"""Of the bins: narrower where most findings are."""
ENOUGH = 10
"""Fewer decisions than this give no score and no prior: their intervals would span nearly everything."""
_Z95 = 1.959964
_BOOTSTRAPS = 2000
_SEVERAL = 3
"""Drives after which overlooking a sign in each of them is no explanation any more."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A finding that a person accepted or dismissed."""

    verdict: Verdict
    confidence: float
    n_drives: int
    is_right: bool


@dataclass(frozen=True, slots=True)
class Bin:
    """Findings of like confidence: how many were right, with the 95 % interval of that share (Wilson)."""

    from_confidence: float
    to_confidence: float
    n: int
    n_right: int
    mean_confidence: float
    share_right: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Score:
    """How true the confidences of one verdict are, or of all of them.

    Attributes
    ----------
    verdict : str
        "" for all.
    brier : float or None
        Mean squared difference of confidence and outcome: 0 is perfect, 0.25 what always saying 50 % gets.
        None for fewer than `ENOUGH` decisions.
    low, high : float or None
        Its 95 % interval, by 2,000 bootstrap samples of the decisions (seeded).
    brier_if_true : float
        What it would be if each confidence were true.
    """

    verdict: str
    n: int
    n_right: int
    mean_confidence: float
    brier: float | None
    low: float | None
    high: float | None
    brier_if_true: float
    bins: tuple[Bin, ...]


@dataclass(frozen=True, slots=True)
class FittedPrior:
    """What an assumption of matching would be by the decisions, with its 95 % interval.

    Attributes
    ----------
    name, held : str
        In :class:`twin.matching.config.MatchConfig`; and what is held at its value, since decisions tell
        only how the two compare.
    n : int
        Decisions that tell.
    fitted, low, high : float or None
        None for fewer than `ENOUGH`.
    """

    name: str
    used: float
    held: str
    n: int
    fitted: float | None
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class ConfidenceReport:
    """Confidences against decisions.

    Attributes
    ----------
    scores : tuple of Score
        All verdicts together first, then each that was decided about.
    priors : tuple of FittedPrior
    n_deferred, n_temporary, n_unknown : int
        Decisions that do not count: put off; dismissed as temporary, where the finding was right; and from
        before the confidence was kept.
    """

    scores: tuple[Score, ...]
    priors: tuple[FittedPrior, ...]
    n_deferred: int
    n_temporary: int
    n_unknown: int

    def as_json(self) -> dict[str, Any]:
        """Return everything in types that JSON has."""
        return asdict(self)


def confidences_against_decisions(store: Store) -> ConfidenceReport:
    """Hold the confidences against what people decided: accepted is right, dismissed is wrong.

    Each finding counts once, with its last decision by a person and the confidence that it had then.
    """
    with store.snapshot() as view:
        log = schema.decision_log
        asked = sa.select(log).where(log.c.kind.in_((DECIDED, UNDONE))).order_by(log.c.id)
        last = {row["change_id"]: Entry.from_row(row) for row in view.rows(asked)}
        settings = (view.fact("last_match") or {}).get("settings", {}).get("matching", {})
    counts: Counter[str] = Counter()
    judged = []
    for entry in last.values():
        if entry.decision == Decision.DEFER:
            counts["deferred"] += 1
        elif isinstance(entry.cause, Temporary):
            counts["temporary"] += 1
        elif entry.decision != Decision.OPEN:
            found = entry.evidence
            if found.confidence is None:
                counts["unknown"] += 1
            else:
                right = entry.decision == Decision.ACCEPT
                judged.append(Judged(Verdict(found.verdict), found.confidence, found.n_drives, right))
    verdicts = [verdict for verdict in Verdict if any(one.verdict == verdict for one in judged)]
    return ConfidenceReport(
        scores=(
            score("", judged),
            *(score(verdict, [one for one in judged if one.verdict == verdict]) for verdict in verdicts),
        ),
        priors=fitted_priors(judged, _config(settings)),
        n_deferred=counts["deferred"],
        n_temporary=counts["temporary"],
        n_unknown=counts["unknown"],
    )


def _config(settings: Mapping[str, Any]) -> MatchConfig:
    """The settings of the last match, as far as this version has them."""
    known = {field.name for field in fields(MatchConfig)}
    return MatchConfig(**{name: value for name, value in settings.items() if name in known})


def score(verdict: str, judged: Sequence[Judged]) -> Score:
    """Score the confidences of some findings; `brier` is None where they are too few."""
    p = np.array([one.confidence for one in judged], dtype=np.float64)
    right = np.array([one.is_right for one in judged], dtype=np.float64)
    squared = (p - right) ** 2
    enough = len(judged) >= ENOUGH
    low, high = _bootstrap(squared) if enough else (None, None)
    return Score(
        verdict=verdict,
        n=len(judged),
        n_right=int(right.sum()),
        mean_confidence=float(p.mean()) if len(p) else math.nan,
        brier=float(squared.mean()) if enough else None,
        low=low,
        high=high,
        brier_if_true=float((p * (1 - p)).mean()) if len(p) else math.nan,
        bins=tuple(_bins(p, right)),
    )


def _bins(p: FloatArray, right: FloatArray) -> list[Bin]:
    which = np.clip(np.digitize(p, EDGES) - 1, 0, len(EDGES) - 2)
    found = []
    for k in np.unique(which).tolist():
        inside = which == k
        n, n_right = int(inside.sum()), int(right[inside].sum())
        mean = float(p[inside].mean())
        found.append(Bin(EDGES[k], EDGES[k + 1], n, n_right, mean, n_right / n, *wilson(n_right, n)))
    return found


def wilson(n_right: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a share by Wilson's score (J. Am. Stat. Assoc. 22, 1927); n at least 1."""
    share, z2 = n_right / n, _Z95**2
    centre = (share + z2 / (2 * n)) / (1 + z2 / n)
    half = _Z95 / (1 + z2 / n) * math.sqrt(share * (1 - share) / n + z2 / (4 * n * n))
    return max(0.0, centre - half), min(1.0, centre + half)


def _bootstrap(values: FloatArray) -> tuple[float, float]:
    rng = np.random.default_rng(0)
    means = rng.choice(values, (_BOOTSTRAPS, len(values))).mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975]).tolist()
    return low, high


def fitted_priors(judged: Sequence[Judged], config: MatchConfig) -> tuple[FittedPrior, ...]:
    """Work out the priors that decisions tell, each with another held at its value.

    - `p_code_wrong`, of ``wrong_type`` that one drive read: NVDB's error against a misreading (`p_misread`).
    - `p_missed`, of ``missing`` that one drive shows: an overlooked sign against one that is gone (`p_gone`).
    - `p_hidden`, of ``missing`` that three drives or more show: none of these overlooked it.

    Decisions say nothing of signs that no finding is about: how many are gone, moved or taken down in a year.
    """
    gone, misread = config.p_gone, config.p_misread

    def code_wrong(share: float) -> float:
        return share * misread / (share * misread + (1 - share) * (1 - misread))

    def unannotated(share: float) -> float:
        return min(1.0, gone * (1 - share) / max(share * (1 - gone), 1e-12))

    def missed(share: float) -> float:
        return max(0.0, (unannotated(share) - config.p_hidden) / (1 - config.p_hidden))

    one_read = [one for one in judged if one.verdict == Verdict.WRONG_TYPE and one.n_drives == 1]
    missing = [one for one in judged if one.verdict == Verdict.MISSING]
    one_passed = [one for one in missing if one.n_drives == 1]
    several_passed = [one for one in missing if one.n_drives >= _SEVERAL]
    return (
        _fitted("p_code_wrong", config.p_code_wrong, "p_misread", one_read, code_wrong),
        _fitted("p_missed", config.p_missed, "p_gone", one_passed, missed),
        _fitted("p_hidden", config.p_hidden, "p_gone", several_passed, unannotated),
    )


def _fitted(
    name: str, used: float, held: str, judged: Sequence[Judged], prior_of: Callable[[float], float]
) -> FittedPrior:
    """Turn the share that was right, and its interval, into a prior by a monotonic function."""
    n = len(judged)
    if n < ENOUGH:
        return FittedPrior(name, used, held, n, None, None, None)
    n_right = sum(one.is_right for one in judged)
    low, high = sorted(map(prior_of, wilson(n_right, n)))
    return FittedPrior(name, used, held, n, prior_of(n_right / n), low, high)


def priors_toml(priors: Sequence[FittedPrior]) -> str:
    """Write the priors that could be fitted as a file for ``twin match --settings``; "" of none."""
    lines = [
        f"{one.name} = {one.fitted:.4g}  # {one.n} decisions, 95 %: {one.low:.4g} to {one.high:.4g}; "
        f"{one.held} held"
        for one in priors
        if one.fitted is not None
    ]
    return "\n".join(["[matching]", *lines, ""]) if lines else ""
