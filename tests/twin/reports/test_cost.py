"""``twin drives --cost``: measured metres and marks times the user's own figures."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import Twin


def test_cost_is_what_was_measured_times_what_the_user_says(
    twin: Twin, store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Figures come from options, or from the environment as a file's do; without --cost there is none."""
    monkeypatch.setenv("TWIN_COST_PER_HOUR", "600")
    options = ("--cost-per-km", 20, "--seconds-per-mark", 5)
    (drive,) = twin("drives", "--cost", *options, "--store", store, "--json").json
    cost = drive["cost"]
    assert cost["length_km"] == pytest.approx(drive["length_m"] / 1e3)
    assert cost["n_marks"] == drive["n_annotations"] > 100
    hours = drive["n_annotations"] * 5 / 3600
    total = 20 * cost["length_km"] + 600 * hours
    assert cost["hours"] == pytest.approx(hours)
    assert cost["total"] == pytest.approx(total)
    assert cost["per_km"] == pytest.approx(total / cost["length_km"])
    assert twin("drives", "--store", store, "--json").json[0]["cost"] is None


def test_figures_that_are_not_given_are_named_and_nothing_is_made_up(twin: Twin, store: Path) -> None:
    """Kilometres and marks stand there alone."""
    told = twin("drives", "--cost", "--store", store)
    assert told.code == 0
    assert "cost_per_km, cost_per_hour, seconds_per_mark" in told.err
    assert [cell.strip() for cell in told.out.splitlines()[4].split("│")[4:9]] == ["–"] * 5
