"""Which pole of earlier matches a pole is: by clicks, else by place, never by the annotator's id."""

from __future__ import annotations

import numpy as np

from twin.matching.config import MatchConfig
from twin.matching.poles.keys import KnownMark, Mark, with_known_keys
from twin.matching.poles.poles import observed_poles
from twin.store.records import Estimate, split_codes

Seen = tuple[str, str, str, float, str]
"""Drive, id, clicks, easting, codes."""


def keys(seen: list[Seen], known: list[KnownMark], sigma_m: float = 0.1) -> dict[str, str]:
    """Key of each member's pole."""
    rows = [
        Estimate(
            drive_id=drive_id,
            object=name,
            codes=split_codes(code),
            east_m=east_m,
            north_m=0.0,
            covariance_m2=(sigma_m**2, 0.0, sigma_m**2),
            cameras=("C1",),
            n_sightings=5,
        )
        for drive_id, name, _, east_m, code in seen
    ]
    marks = {f"{d}:{name}": Mark(d, clicks, east, 0.0, (code,)) for d, name, clicks, east, code in seen}
    poles = with_known_keys(observed_poles(rows, ["a", "b"], MatchConfig()), marks, known)
    assert len({pole.key for pole in poles}) == len(poles)
    return {member: pole.key for pole in poles for member in pole.members}


def known(*marks: tuple[str, str, float, str, str]) -> list[KnownMark]:
    """Marks of earlier matches: drive, clicks, easting, codes, key."""
    return [KnownMark(Mark(d, clicks, east, 0.0, (code,)), key) for d, clicks, east, code, key in marks]


def test_same_clicks_are_the_same_pole_under_any_id_and_at_any_place() -> None:
    """Numbers exchanged and all moved by as much as the poles are apart: each keeps its key."""
    before = known(("a", "x", 0.0, "202", "a:1"), ("a", "y", 1.5, "202", "a:2"))
    now = [("a", "2", "x", 1.5, "202"), ("a", "1", "y", 3.0, "202")]
    assert keys(now, before) == {"a:2": "a:1", "a:1": "a:2"}


def test_objects_clicked_alike_keep_their_keys() -> None:
    """Two objects of the same clicks, in either order: each is the pole that stood there."""
    before = known(("a", "x", 1.5, "202", "a:2"), ("a", "x", 0.0, "202", "a:1"))
    now = [("a", "1", "x", 0.0, "202"), ("a", "2", "x", 1.5, "202")]
    assert keys(now, before) == keys(now, before[::-1]) == {"a:1": "a:1", "a:2": "a:2"}


def test_other_clicks_are_the_nearest_pole_of_before() -> None:
    """Another person's clicks and numbers: the nearer one of two poles 1.5 m apart, one of them taken out."""
    before = known(("a", "x", 0.0, "202", "a:1"), ("a", "y", 1.5, "202", "a:2"))
    assert keys([("a", "1", "z", 1.3, "202")], before) == {"a:1": "a:2"}
    both = [("a", "2", "z", 0.6, "202"), ("a", "1", "w", 2.1, "202")]
    assert keys(both, before) == {"a:2": "a:1", "a:1": "a:2"}


def test_same_code_counts_more_than_half_a_metre() -> None:
    """Between two poles of before, the one with its sign code is it."""
    before = known(("a", "x", 0.0, "202", "a:1"), ("a", "y", 1.5, "404", "a:2"))
    assert keys([("a", "1", "z", 0.7, "404")], before) == {"a:1": "a:2"}


def test_pole_out_of_reach_is_another_one_and_gets_no_name_that_was_used() -> None:
    """Its id was another pole's: it must not get that one's key, and thereby its decisions."""
    before = known(("a", "x", 0.0, "202", "a:1"), ("a", "y", 50.0, "202", "a:1+"))
    assert keys([("a", "1", "z", 2.1, "202")], before) == {"a:1": "a:1++"}
    assert keys([("a", "1", "z", 2.1, "202")], before, sigma_m=1.0) == {"a:1": "a:1"}


def test_pole_keeps_its_key_when_an_earlier_drive_arrives_later() -> None:
    """The key is the first that it got, whatever drive comes first in time."""
    seen = [("a", "7", "p", 0.0, "202"), ("b", "1", "q", 0.1, "202")]
    assert set(keys(seen, known(("b", "q", 0.1, "202", "b:1"))).values()) == {"b:1"}


def test_pole_that_comes_apart_leaves_its_key_to_the_oldest_part() -> None:
    """Three that an earlier run took for one: the others get keys of their own, and keep them."""
    seen = [("a", "1", "p", 0.0, "202"), ("b", "9", "q", 5.0, "202"), ("b", "7", "r", 9.0, "204")]
    before = known(*((d, clicks, east, code, "b:9") for d, _, clicks, east, code in seen))
    found = keys(seen, before)
    assert found == {"a:1": "b:9", "b:9": "b:9+", "b:7": "b:7"}
    after = known(*((d, clicks, east, code, found[f"{d}:{n}"]) for d, n, clicks, east, code in seen))
    assert keys(seen, [*before, *after]) == found


def test_poles_that_came_together_and_apart_have_their_keys_again() -> None:
    """What a pole was once called is not forgotten while it is taken for another one."""
    before = known(
        ("a", "p", 0.0, "202", "a:1"), ("b", "q", 0.2, "202", "b:9"), ("b", "q", 0.2, "202", "a:1")
    )
    together = [("a", "1", "p", 0.0, "202"), ("b", "9", "q", 0.1, "202")]
    assert set(keys(together, before).values()) == {"a:1"}
    apart = [("a", "1", "p", 0.0, "202"), ("b", "9", "q", 5.0, "202")]
    assert keys(apart, before) == {"a:1": "a:1", "b:9": "b:9"}


def test_any_numbering_gives_the_same_keys_by_clicks_and_by_place() -> None:
    """Twenty poles 1.5 to 30 m apart, numbered at random, with clicks of before or a hand's breadth off."""
    rng = np.random.default_rng(3)
    east = np.cumsum(rng.uniform(1.5, 30, 20))
    before = known(*(("a", f"c{k}", x, "202", f"a:{k}") for k, x in enumerate(east)))
    for _ in range(20):
        number = rng.permutation(20).tolist()
        same = rng.random(20) < 0.5
        seen = [
            ("a", str(number[k]), f"c{k}" if same[k] else f"other{k}", x + rng.normal(0, 0.1), "202")
            for k, x in enumerate(east)
        ]
        assert keys(seen, before) == {f"a:{number[k]}": f"a:{k}" for k in range(20)}
