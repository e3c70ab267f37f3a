"""Road works: one sign dismissed as temporary speaks for the others, as far and as long as the works last."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from findings import finding

from twin.decisions.findings import latest_findings
from twin.decisions.log import history
from twin.decisions.record import decide, undo
from twin.errors import ConfigError
from twin.matching.save import save_changes
from twin.store.kinds import Decision, Verdict
from twin.store.records import Finding
from twin.store.store import Store
from twin.words import Lang

EAST, NORTH = 270_000.0, 7_041_000.0


def sign(
    change_id: str,
    codes: str = "110",
    *,
    apart_m: float = 0.0,
    first: str = "2026-06-10",
    last: str | None = None,
    verdict: Verdict = Verdict.NEW,
) -> Finding:
    """Make a finding of a sign that NVDB does not have, seen between two days."""
    days = {"first": f"{first}T08:00:00Z", "last": f"{last or first}T08:00:03Z", "drives": 1}
    return finding(
        change_id,
        verdict=verdict,
        skiltnummer_seen=tuple(codes.split(";")),
        east_m=EAST + apart_m,
        north_m=NORTH,
        terms={"pole": change_id, "seen": days},
    )


def match(store: Store, *found: Finding) -> None:
    """Leave what a match leaves."""
    save_changes(store, found, {}, {"method": "m", "at": "2026-06-11T00:00:00Z"})


def open_ones(store: Store) -> list[str]:
    """Read the findings that somebody still has to decide about."""
    return [one.change_id for one in latest_findings(store.rows) if one.is_open]


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """Return a store in which kari dismissed the sign ``works`` as temporary."""
    with Store.open(tmp_path / "small.db") as opened:
        match(opened, sign("works"))
        decide(opened, ["works"], "dismiss", by="kari", temporary=True)
        yield opened


@pytest.mark.parametrize(
    ("other", "is_open"),
    [
        (sign("near", apart_m=250), False),
        (sign("near", apart_m=350), True),
        (sign("near", "110;802"), False),
        (sign("near", "110;362.50"), True),
        (sign("near", "362.50"), True),
        (sign("near", "802"), True),
        (sign("near", verdict=Verdict.REVIEW), False),
        (sign("near", first="2026-09-08"), False),
        (sign("near", first="2026-09-10"), True),
        (sign("near", first="2025-06-10"), True),
        (sign("near", first="2025-06-10", last="2026-06-20"), False),
    ],
)
def test_sign_of_the_same_works_needs_no_decision(store: Store, other: Finding, is_open: bool) -> None:
    """Near, of road works alone, and not first seen long after the last of them was."""
    match(store, sign("works"), other)
    assert open_ones(store) == ["near"] * is_open


def test_works_last_while_any_of_their_signs_is_seen(store: Store) -> None:
    """What is first seen within the time of one that was dismissed with them belongs to them, too."""
    later = [
        sign("august", apart_m=100, first="2026-08-20", last="2026-10-01"),
        sign("december", apart_m=200, first="2026-12-01"),
    ]
    match(store, *later)
    assert open_ones(store) == []
    match(store, later[1])
    assert open_ones(store) == ["december"]


def test_nothing_remains_of_works_that_are_over(store: Store) -> None:
    """Signs that are no longer found are in no list, and a year later new works are open."""
    match(store, sign("works"), sign("near", apart_m=50))
    match(store)
    assert latest_findings(store.rows) == []
    match(store, sign("again", apart_m=50, first="2027-06-10"))
    assert open_ones(store) == ["again"]


def test_decision_taken_back_opens_all_that_rested_on_it(store: Store) -> None:
    """The log says who dismissed the works, and that they no longer speak for the sign."""
    match(store, sign("works"), sign("near", apart_m=50))
    undo(store, by="ola")
    assert open_ones(store) == ["near", "works"]
    one, two = history(store.rows, "near")
    assert (one.decision, one.by, two.decision, two.by) == ("dismiss", "twin", "open", "twin")
    assert one.told(Lang.EN) == f"Belongs to the road works of works, dismissed {one.at[:10]} by kari."
    assert two.told(Lang.NB) == "Det er ikke lenger noe avvist vegarbeid i nærheten."


def test_person_has_the_last_word_on_each_sign(store: Store) -> None:
    """Opened or accepted by a person it stays so, whatever is matched again."""
    signs = [sign("works"), sign("a", apart_m=50), sign("b", apart_m=60)]
    match(store, *signs)
    decide(store, ["a"], "open", by="ola")
    decide(store, ["b"], "accept", by="ola")
    match(store, *signs)
    assert {one.change_id: one.decision for one in latest_findings(store.rows)} == {
        "a": Decision.OPEN,
        "b": Decision.ACCEPT,
        "works": Decision.DISMISS,
    }


def test_same_match_again_adds_nothing_to_the_log(store: Store) -> None:
    """However often it is matched."""
    for _ in range(3):
        match(store, sign("works"), sign("near", apart_m=50))
    assert len(history(store.rows, "near")) == 1


def test_dismissal_without_the_cause_speaks_for_itself_alone(tmp_path: Path) -> None:
    """Whatever its reason says: no text decides."""
    with Store.open(tmp_path / "plain.db") as plain:
        match(plain, sign("works"), sign("near", apart_m=50))
        decide(plain, ["works"], "dismiss", by="kari", reason="temporary road works")
        assert open_ones(plain) == ["near"]
        with pytest.raises(ConfigError, match="only dismiss takes that"):
            decide(plain, ["near"], "accept", by="kari", temporary=True)
        decide(plain, ["works"], "dismiss", by="kari", temporary=True)
        assert open_ones(plain) == []


def test_only_a_sign_that_nvdb_lacks_is_temporary(matched_store: Path, tmp_path: Path) -> None:
    """A sign that NVDB has stands for good: dismissing its finding so would hide a wrong verdict."""
    with Store.open(shutil.copy(matched_store, tmp_path / "twin.db")) as sample:
        (moved,) = (one for one in latest_findings(sample.rows) if one.finding.verdict == Verdict.MOVED)
        with pytest.raises(ConfigError, match="a sign that NVDB has"):
            decide(sample, [moved.change_id], "dismiss", by="kari", temporary=True)
        assert history(sample.rows, moved.change_id) == []
