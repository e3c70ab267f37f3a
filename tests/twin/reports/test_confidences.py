"""Confidences against decisions: scores, their intervals, and what the priors would be."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from command_line import Twin
from findings import finding

from twin.decisions.record import decide
from twin.errors import ConfigError
from twin.matching.config import MatchConfig, settings_from
from twin.matching.plates.readings import PlateReading, code_chances
from twin.matching.save import save_changes
from twin.reports.confidence_picture import draw_confidences
from twin.reports.confidences import (
    Judged,
    confidences_against_decisions,
    fitted_priors,
    priors_toml,
    score,
    wilson,
)
from twin.store.kinds import Verdict
from twin.store.records import Finding
from twin.store.store import Store
from twin.words import Lang


def judged(
    verdict: Verdict, n: int, n_right: int, *, confidence: float = 0.9, n_drives: int = 1
) -> list[Judged]:
    """Make findings of one confidence, some of them right."""
    return [Judged(verdict, confidence, n_drives, k < n_right) for k in range(n)]


def test_wilson_interval_is_that_of_the_textbook() -> None:
    """8 of 10: 0.490 to 0.943 (Newcombe 1998, method 3); 0 of 10 begins at 0 and is not empty."""
    assert wilson(8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    low, high = wilson(0, 10)
    assert (low, round(high, 4)) == (0.0, 0.2775)


def test_brier_score_is_the_mean_squared_difference() -> None:
    """By hand: 16 of 20 right at 0.9 is (16 × 0.01 + 4 × 0.81) / 20; true confidences would give 0.09."""
    got = score("", judged(Verdict.NEW, 20, 16))
    assert got.brier == pytest.approx(0.17)
    assert got.brier_if_true == pytest.approx(0.09)
    assert got.low is not None
    assert got.high is not None
    assert got.low < 0.17 < got.high
    (one,) = got.bins
    assert (one.from_confidence, one.n, one.n_right, one.share_right) == (0.9, 20, 16, 0.8)


def test_true_confidences_lie_in_their_intervals() -> None:
    """Outcomes drawn by the confidences: nearly every bin's interval holds the mean confidence said."""
    rng = np.random.default_rng(1)
    p = rng.uniform(0.3, 1.0, 4000)
    got = score(
        "",
        [Judged(Verdict.NEW, c, 1, bool(r)) for c, r in zip(p.tolist(), rng.random(4000) < p, strict=True)],
    )
    assert got.brier is not None
    assert abs(got.brier - got.brier_if_true) < 0.01
    held = [one.low <= one.mean_confidence <= one.high for one in got.bins]
    assert sum(held) >= len(held) - 1


def test_fitted_prior_gives_back_the_confidence_that_was_right() -> None:
    """With the prior that decisions suggest, matching itself says the share that was right: 30 of 60."""
    (fitted, *_) = fitted_priors(judged(Verdict.WRONG_TYPE, 60, 30), MatchConfig())
    assert fitted.name == "p_code_wrong"
    assert fitted.fitted is not None
    config = MatchConfig(p_code_wrong=fitted.fitted)
    votes = (PlateReading(code="362.60", drive_id="d", epoch_ns=0),)
    assert code_chances(votes, "362.50", config)["362.60"] == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize(("n_drives", "name"), [(1, "p_missed"), (3, "p_hidden")])
def test_overlooked_signs_tell_their_prior(n_drives: int, name: str) -> None:
    """30 of 40 missing signs were gone: the chance that one stands unseen is a third of that it is gone."""
    config = MatchConfig()
    found = judged(Verdict.MISSING, 40, 30, n_drives=n_drives)
    prior = next(one for one in fitted_priors(found, config) if one.name == name)
    assert prior.fitted is not None
    assert prior.low is not None
    assert prior.high is not None
    assert prior.low < prior.fitted < prior.high
    unseen = prior.fitted
    if name == "p_missed":
        unseen = config.p_hidden + (1 - config.p_hidden) * prior.fitted
    assert config.p_gone / (config.p_gone + (1 - config.p_gone) * unseen) == pytest.approx(0.75)


def test_few_decisions_fit_nothing() -> None:
    """Nine decisions give no score and no prior."""
    found = judged(Verdict.WRONG_TYPE, 9, 6)
    assert score("", found).brier is None
    assert all(one.fitted is None for one in fitted_priors(found, MatchConfig()))
    assert priors_toml(fitted_priors(found, MatchConfig())) == ""


def kept(path: Path, found: Sequence[Finding]) -> Store:
    """A store with these findings."""
    store = Store.open(path)
    save_changes(store, found, {}, {"method": "m", "at": "2026-06-11T00:00:00Z"})
    return store


def test_each_finding_counts_with_its_last_decision(tmp_path: Path) -> None:
    """Deferred and temporary ones do not count, open ones neither; the confidence is that of the decision."""
    found = [finding(name, east_m=100.0 * k, confidence=0.8) for k, name in enumerate("abcde")]
    with kept(tmp_path / "small.db", found) as store:
        decide(store, ["a", "b"], "accept", by="kari")
        decide(store, ["b"], "dismiss", by="ola")
        decide(store, ["c"], "defer", by="kari")
        decide(store, ["d"], "dismiss", by="kari", temporary=True)
        save_changes(store, [], {}, {"method": "m", "at": "2026-06-12T00:00:00Z"})
        report = confidences_against_decisions(store)
    everything, new = report.scores
    assert (everything.n, everything.n_right, everything.mean_confidence) == (2, 1, pytest.approx(0.8))
    assert new.verdict == Verdict.NEW
    assert (report.n_deferred, report.n_temporary, report.n_unknown) == (1, 1, 0)


def test_command_says_what_is_too_few_and_what_fits(twin: Twin, tmp_path: Path) -> None:
    """In both languages, with a figure; the file that it prints is one that matching takes."""
    path = tmp_path / "small.db"
    found = [
        finding(
            f"a{k:02}", verdict=Verdict.WRONG_TYPE, nvdb_type=96, nvdb_id=k, confidence=0.67, east_m=9.0 * k
        )
        for k in range(20)
    ]
    with kept(path, found) as store:
        decide(store, [f"a{k:02}" for k in range(15)], "accept", by="kari")
        decide(store, [f"a{k:02}" for k in range(15, 20)], "dismiss", by="kari")
    answer = twin("confidence", "--out", tmp_path / "figure.svg", "--store", path)
    assert answer.code == 0
    toml = answer.out[answer.out.index("[matching]") :]
    assert tomllib.loads(toml)["matching"]["p_code_wrong"] == pytest.approx(0.0294, abs=1e-4)
    assert "p_missed cannot be told from decisions yet: 0 of at least 10" in answer.err
    assert (tmp_path / "figure.svg").read_bytes().startswith(b"<?xml")
    (tmp_path / "priors.toml").write_text(toml)
    assert settings_from(tmp_path / "priors.toml") == MatchConfig(p_code_wrong=0.02941)
    norsk = twin("confidence", "--lang", "nb", "--store", path)
    assert "feil skilttype" in norsk.out
    assert "0,194" in norsk.out


def test_store_without_decisions_says_so(twin: Twin, tmp_path: Path) -> None:
    """No score, and one sentence that says why; the figure is drawn all the same."""
    Store.open(tmp_path / "empty.db").close()
    answer = twin("confidence", "--out", tmp_path / "figure.png", "--store", tmp_path / "empty.db")
    assert answer.code == 0
    assert "Too few decisions for a score of all verdicts: fewer than 10." in answer.err
    assert (tmp_path / "figure.png").stat().st_size > 0


def test_figure_of_another_kind_is_refused(tmp_path: Path) -> None:
    """One sentence with the cure."""
    with kept(tmp_path / "small.db", []) as store:
        report = confidences_against_decisions(store)
    with pytest.raises(ConfigError, match=r"neither PNG, SVG nor PDF"):
        draw_confidences(report, tmp_path / "figure.jpg")


def test_same_decisions_give_the_same_bytes(tmp_path: Path) -> None:
    """An SVG has no clock and no chance in it."""
    with kept(tmp_path / "small.db", []) as store:
        report = confidences_against_decisions(store)
    one, two = (draw_confidences(report, tmp_path / f"{k}.svg", Lang.NB).read_bytes() for k in "ab")
    assert one == two


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[matching]\np_mised = 0.1\n", "name 'p_mised', which matching does not have"),
        ("[matching]\np_missed = 'few'\n", "give p_missed as 'few': give a number"),
        ("[matching]\nmap_aided = true\n", "name 'map_aided'"),
        ("[matching]\nmin_views = 2.5\n", "give min_views as 2.5: give a whole number"),
        ("[matching]\np_missed = 2\n", "p_missed of matching is 2: give a share"),
        ("p_missed = 0.1\n", r"no table \[matching\]"),
        ("[matching\n", "are no TOML"),
    ],
)
def test_settings_that_are_wrong_are_one_sentence(tmp_path: Path, text: str, told: str) -> None:
    """What, where, and what to do."""
    path = tmp_path / "settings.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=told):
        settings_from(path)
