"""Texts on plates: how they compare, what they weigh, and what is said where they differ."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin.matching.assign import Assignment, assign
from twin.matching.config import MatchConfig
from twin.matching.likelihood import TERMS
from twin.matching.plates.texts import split_texts, text_odds, text_pairs
from twin.matching.plates.wording import normalised, similarity
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.matching.sites import Plate, Site
from twin.matching.verdicts.judge import judge
from twin.store.records import Estimate, Finding, split_codes

CONFIG = MatchConfig()
BUS, LENGTH = "Gjelder buss", "200 m"


def pole(east: float, *plates: tuple[str, str], key: str = "d:1", sigma: float = 0.2) -> ObservedPole:
    """Make an observed pole of plates (code, text)."""
    codes, texts = tuple(code for code, _ in plates), tuple(text for _, text in plates)
    return ObservedPole(
        (key,),
        key,
        east,
        0.0,
        sigma**2 * np.eye(2),
        codes,
        ("d",),
        frozenset({"d/C"}),
        10,
        texts=texts if any(texts) else (),
    )


def site(nvdb_id: int, east: float, *plates: tuple[str, str]) -> Site:
    """Make a site of plates (code, text) with the ids 10 * nvdb_id, and on."""
    made = tuple(Plate(10 * nvdb_id + i, 1, code, "med", text=text) for i, (code, text) in enumerate(plates))
    return Site(95, nvdb_id, 1, east, 0.0, 0.3, True, made)


def matched(poles: list[ObservedPole], sites: list[Site]) -> tuple[Assignment, list[Finding]]:
    """Assign and judge, every site in view of a complete drive."""
    assignment = assign(poles, sites, np.full(len(sites), CONFIG.p_missed), CONFIG)
    return assignment, judge(poles, sites, assignment, np.full(len(sites), 50), [["d"]] * len(sites), CONFIG)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("200 m", "200m"),
        ("Gjelder  BUSS", "gjelder buss"),
        ("1,5 km", "1.5 km"),
        ("0 – 300 m", "0-300 m"),
        ("Å", "A\u030a"),
    ],
)
def test_texts_that_people_read_alike_are_the_same(one: str, other: str) -> None:
    """Case, blanks, the decimal comma, dashes and the two spellings of å in Unicode do not matter."""
    assert normalised(one) == normalised(other) != ""
    assert similarity(one, other) == 1.0


def test_letters_of_their_own_stay_apart() -> None:
    """Bø and Bo are two places."""
    assert normalised("Bø") != normalised("Bo")


@pytest.mark.parametrize("filler", ["", ".", "N/A", " - "])
def test_text_that_says_nothing_is_worth_nothing(filler: str) -> None:
    """NVDB's fillers are no texts, on whichever side they stand."""
    assert math.isnan(similarity(filler, BUS))
    assert math.isnan(similarity(BUS, filler))
    assert text_odds(math.nan, CONFIG) == 0.0


def test_numbers_decide() -> None:
    """200 m and 300 m share three letters of four and are two signs; hours are the same however written."""
    assert similarity("200 m", "300 m") == 0.0
    assert similarity("08.00-17.00", "8-17") > 0.0
    assert similarity("Trondheim 12", "Trondheim") > CONFIG.text_alike


def test_text_odds_fall_from_same_to_misspelt_to_other() -> None:
    """A misspelt text still speaks for the pair, another one against it."""
    same, misspelt, other = (
        text_odds(similarity("Gjelder buss", text), CONFIG)
        for text in ("gjelder buss", "Gjeldr bus", "Unntatt trikk")
    )
    assert same > misspelt > 0 > other
    # By hand: 0.85 / 0.05, 0.1 / 0.05 and 0.05 / 0.9.
    assert [same, misspelt, other] == pytest.approx([math.log(17), math.log(2), math.log(1 / 18)])


def test_text_odds_are_finite_whatever_the_priors() -> None:
    """Chances of 0 and 1 are allowed."""
    for value in (0.0, 1.0):
        config = MatchConfig(p_text_other=value, p_text_misspelt=value, p_text_by_chance=value)
        assert all(math.isfinite(text_odds(alike, config)) for alike in (0.0, 0.9, 1.0))


@pytest.mark.parametrize(
    ("text", "codes", "texts"),
    [
        (None, ("362.50",), ()),
        ("200 m", (), ()),
        (" ; ", ("362.50", "808.1"), ()),
        (";200 m", ("362.50", "808.1"), ("", "200 m")),
        ("200 m", ("362.50", "808.1"), ("", "200 m")),
        ("200 m;Gjelder buss", ("362.50", "802", "808.1"), ("", "200 m", "Gjelder buss")),
        ("skole", ("142", "156"), ("skole", "")),
        ("man-fre; 8-17", ("808.1",), ("man-fre 8-17",)),
    ],
)
def test_texts_find_their_plates(text: str | None, codes: tuple[str, ...], texts: tuple[str, ...]) -> None:
    """Top down like the codes; as many as there are 7xx and 8xx may stand alone."""
    assert split_texts(text, codes) == texts


def test_text_pairs_prefer_the_code_then_the_text() -> None:
    """Two plates of one code are told apart by their texts, a third of the family takes what is left."""
    plates = site(1, 0.0, ("808.1", BUS), ("808.1", LENGTH), ("808.2", BUS)).plates
    pairs = text_pairs(("808.1", "808.1", "808.5"), (LENGTH, BUS, ""), plates, CONFIG)
    assert [(k, j) for k, j, _ in sorted(pairs)] == [(0, 1), (1, 0), (2, 2)]


def test_poles_of_equal_codes_are_told_apart_by_their_texts() -> None:
    """Two poles that stand between two sites alike: only the texts say which is which."""
    sites = [site(1, -0.4, ("808.1", LENGTH)), site(2, 0.4, ("808.1", BUS))]
    places = {LENGTH: 0.05, BUS: -0.05}
    plain = [pole(east, ("808.1", ""), key=f"d:{k}") for k, east in enumerate(places.values())]
    said = [pole(east, ("808.1", text), key=f"d:{k}") for k, (text, east) in enumerate(places.items())]
    assert matched(plain, sites)[0].site_of_pole.tolist() == [1, 0]
    assignment, changes = matched(said, sites)
    assert assignment.site_of_pole.tolist() == [0, 1]
    assert (assignment.terms_of_pole[:, TERMS.index("text")] > 2).all()
    assert [change.verdict for change in changes] == ["unchanged"] * 2


def test_plates_of_equal_codes_on_one_pole_are_told_apart_by_their_texts() -> None:
    """Only one of two is there: the missing plate is the one whose text was not read."""
    known = site(1, 0.0, ("808.1", LENGTH), ("808.1", BUS))
    _, (first,) = matched([pole(0.0, ("808.1", ""))], [known])
    _, (second,) = matched([pole(0.0, ("808.1", LENGTH))], [known])
    _, (third,) = matched([pole(0.0, ("808.1", BUS))], [known])
    assert [c.verdict for c in (first, second, third)] == ["missing"] * 3
    assert [c.nvdb_id for c in (first, second, third)] == [11, 11, 10]


def test_misspelt_text_is_the_same_sign() -> None:
    """It speaks for the pair, and the reason does not mention it."""
    _, (change,) = matched([pole(0.1, ("808.1", "Gjeldr bus"))], [site(1, 0.0, ("808.1", BUS))])
    assert change.verdict == "unchanged"
    assert change.terms["log_odds"]["text"] > 0
    assert "reads" not in change.reason
    (told,) = change.terms["texts"]
    assert (told["seen"], told["nvdb"], told["differs"]) == ("Gjeldr bus", BUS, False)


def test_another_text_is_no_verdict_but_is_said() -> None:
    """The sign stays unchanged under the same id; reason and terms say what reads otherwise."""
    known = site(1, 0.0, ("362.50", ""), ("808.1", LENGTH))
    _, (plain,) = matched([pole(0.1, ("362.50", ""), ("808.1", ""))], [known])
    _, (change,) = matched([pole(0.1, ("362.50", ""), ("808.1", "300 m"))], [known])
    assert (change.verdict, change.change_id) == ("unchanged", plain.change_id)
    assert 'though 808.1 reads "300 m" and in NVDB "200 m"' in change.reason
    assert change.terms["texts"] == [
        {"nvdb_id": 11, "code": "808.1", "seen": "300 m", "nvdb": "200 m", "alike": 0.0, "differs": True}
    ]
    assert change.terms["log_odds"]["text"] < 0
    assert 0.95 < change.confidence < plain.confidence


def test_text_of_one_side_alone_changes_nothing() -> None:
    """Whether only the drive or only NVDB knows a text: the same findings as without any."""
    plates, said = [("362.50", ""), ("808.1", "")], [("362.50", ""), ("808.1", LENGTH)]
    (one, without), (_, of_drive), (_, of_nvdb) = (
        matched([pole(0.1, *seen)], [site(1, 0.0, *known)])
        for seen, known in ((plates, plates), (said, plates), (plates, said))
    )
    assert one.terms_of_pole[0, TERMS.index("text")] == 0.0
    assert without == of_drive == of_nvdb
    assert "texts" not in without[0].terms


def estimate(drive: str, code: str, text: str | None, name: str = "1", camera: str = "C1") -> Estimate:
    """Make an estimate at the origin."""
    place = (0.0, 0.0, (0.04, 0.0, 0.04))
    return Estimate(drive, name, split_codes(code), *place, cameras=(camera,), n_sightings=5, text=text)


def test_observed_pole_has_the_text_that_was_read_last() -> None:
    """A drive that could not read it takes nothing away; the later word holds."""
    rows = [
        estimate(d, "362.50;808.1", text) for d, text in zip("abc", (";200 m", ";300 m", None), strict=True)
    ]
    (one,) = observed_poles(rows, ["a", "b", "c"], CONFIG)
    assert (one.codes, one.texts) == (("362.50", "808.1"), ("", "300 m"))
    assert [[r.drive_id for r in plate] for plate in one.readings()] == [["a", "b", "c"]] * 2


def test_observed_pole_keeps_texts_with_their_plates() -> None:
    """A second drive numbered two plates of one code the other way round."""
    rows = [estimate("a", "808.1;808.1", f"{BUS};{LENGTH}"), estimate("b", "808.1;808.1", f"{LENGTH};{BUS}")]
    (one,) = observed_poles(rows, ["a", "b"], CONFIG)
    assert one.texts == (BUS, LENGTH)
    assert [{r.text for r in plate} for plate in one.readings()] == [{BUS}, {LENGTH}]


def test_observed_pole_of_plates_drawn_one_by_one_has_their_texts() -> None:
    """Two objects at one foot; and what a second camera read is no second vote."""
    rows = [estimate("a", "362.50", None, "1"), estimate("a", "808.1", LENGTH, "2")]
    (one,) = observed_poles(rows, ["a"], CONFIG)
    assert (one.codes, one.texts) == (("362.50", "808.1"), ("", LENGTH))
    rows = [estimate("a", "808.1", None, "1"), estimate("a", "808.1", LENGTH, "2", "C2")]
    (one,) = observed_poles(rows, ["a"], CONFIG)
    assert one.texts == (LENGTH,)
    assert len(one.readings()[0]) == 1
