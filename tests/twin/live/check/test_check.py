"""The check against small mirrors, and on the sample against what a match finds in the same drive."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from command_line import Twin

from geoloc.arrays import BoolArray, FloatArray
from geoloc.earth.geodesy import geographic_from_utm33, utm33_from_geographic
from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.live import Arrival, Estimate, Frame, LiveEngine, State, arrivals_of, car_of
from twin.live.check import LiveCheck, MirrorAhead, Standing, Verdict
from twin.live.check.ahead import SignTree
from twin.matching import MatchConfig
from twin.matching.sites import Plate, Site, sites_from_mirror
from twin.store import schema
from twin.store.kinds import Verdict as Matched
from twin.store.records import Finding
from twin.store.store import Store
from twin.words.reasons import Moved

CONFIG = MatchConfig()
MISSING = 1042500115
"""The Skiltpunkt of the sample that no longer stands."""
E0, N0 = 270_000.0, 7_040_000.0
SECOND_NS = 1_000_000_000


class Country:
    """Some signs, all of them at hand."""

    common: Mapping[str, float] = {}

    def __init__(self, sites: Sequence[Site]) -> None:
        self._tree = SignTree(sites)

    def move(self, place_m: FloatArray) -> bool:
        """All signs are there already."""
        return True

    def near(self, places_m: FloatArray, reach_m: float) -> list[Site]:
        """As `SignsAhead`."""
        return self._tree.near(places_m, reach_m)

    def is_mirrored(self, places_m: FloatArray) -> BoolArray:
        """As `SignsAhead`."""
        return np.asarray(self._tree.distance_m(places_m) < 1000.0)

    def close(self) -> None:
        """Nothing is open."""


def sites_of(path: Path) -> list[Site]:
    """All signs of a store."""
    with Store.open(path) as store:
        point, plate = schema.skiltpunkt, schema.skiltplate
        return sites_from_mirror(store.rows(sa.select(point)), store.rows(sa.select(plate)), CONFIG)


@pytest.fixture(scope="module")
def drive(sample: Path) -> Drive:
    """The sample's first trip."""
    return read_drive(sample / "trip_trondheim")


def passing(drive: Drive, site: Site) -> tuple[int, int, float]:
    """When the car is within 35 m of a sign, and where it looks then (degrees)."""
    fixes = drive.gnss[0]
    east, north = utm33_from_geographic(fixes.latitude_deg, fixes.longitude_deg)
    near = np.flatnonzero(np.hypot(east - site.east_m, north - site.north_m) < 35.0)
    first, last = near[0], near[-1]
    heading = np.degrees(np.arctan2(east[last] - east[first], north[last] - north[first]))
    return int(fixes.host_ns[first]), int(fixes.host_ns[last]), float(heading)


@pytest.fixture(scope="module")
def said(drive: Drive, synced_store: Path) -> dict[str, list[Verdict]]:
    """What several checks say of one and the same drive."""
    engine, sites = LiveEngine(car_of(drive)), sites_of(synced_store)
    gone = next(site for site in sites if site.nvdb_id == MISSING)
    begin_ns, end_ns, heading_deg = passing(drive, gone)
    away = replace(gone, plates=tuple(replace(one, faces_deg=(heading_deg, np.nan)) for one in gone.plates))
    with Store.open(synced_store) as store:
        checks = {
            "all": LiveCheck(engine, MirrorAhead(store, CONFIG), is_complete=True),
            "not complete": LiveCheck(engine, Country([gone]), is_complete=False),
            "facing away": LiveCheck(engine, Country([away]), is_complete=True),
            "without its frames": LiveCheck(engine, Country([gone]), is_complete=True),
            "something was never located": LiveCheck(engine, Country([gone]), is_complete=True),
            "as it is": LiveCheck(engine, Country([gone]), is_complete=True),
        }
        found: dict[str, list[Verdict]] = {name: [] for name in checks}
        for arrival in arrivals_of(drive):
            estimates = engine.feed(arrival)
            is_beside = isinstance(arrival.what, Frame) and begin_ns <= arrival.at_ns <= end_ns
            for name, check in checks.items():
                more = list(estimates)
                if name == "without its frames" and is_beside:
                    continue
                if name == "something was never located" and is_beside:
                    more.append(estimate("L", 0, 0, state=State.LOST, seen=(begin_ns, end_ns)))
                found[name] += check.take(arrival, more)
        ended = engine.finish()
        for name, check in checks.items():
            found[name] += check.finish(ended)
    return found


def last_of(verdicts: Sequence[Verdict]) -> dict[str, Verdict]:
    """What was said last of each sign, of those of which something holds."""
    last = {one.id: one for one in verdicts}
    quiet = (Standing.EXPECTED, Standing.WITHDRAWN)
    return {name: one for name, one in last.items() if one.standing not in quiet}


def test_the_sample_ends_with_the_findings_of_its_match(
    said: dict[str, list[Verdict]], matched_store: Path
) -> None:
    """Each finding of the match is the live check's last word on that sign, at its place, as sure."""
    with Store.open(matched_store) as store:
        findings = [Finding.from_row(row) for row in store.rows(sa.select(schema.change))]
    settled = [one for one in findings if one.verdict is not Matched.REVIEW]
    left = list(last_of(said["all"]).values())
    assert {one.verdict for one in settled} == {Matched(one.standing.value) for one in left}
    for one in settled:
        same = next(
            live
            for live in left
            if (live.standing.value, live.nvdb_type, live.nvdb_id, live.skiltnummer_seen)
            == (one.verdict.value, one.nvdb_type, one.nvdb_id, one.skiltnummer_seen)
        )
        left.remove(same)
        assert same.is_final
        assert np.hypot(same.east_m - one.east_m, same.north_m - one.north_m) < 0.2
        assert same.confidence == pytest.approx(one.confidence, abs=0.02)
    assert not left


def test_a_verdict_says_what_it_was(said: dict[str, list[Verdict]]) -> None:
    """Every line of a sign begins where the one before it ended; expected signs are said before they come."""
    before: dict[str, Standing] = {}
    for one in said["all"]:
        assert one.was is before.get(one.id)
        before[one.id] = one.standing
        assert not one.first_seen_ns or one.at_ns >= one.first_seen_ns
    known = {one.id for one in said["all"] if one.nvdb_type == 95 and one.nvdb_id is not None}
    expected = {one.id for one in said["all"] if one.standing is Standing.EXPECTED and one.was is None}
    assert known - expected <= {f"95:{MISSING - 14}", f"95:{MISSING - 13}", f"95:{MISSING - 12}"}


@pytest.mark.parametrize(
    "name", ["not complete", "facing away", "without its frames", "something was never located"]
)
def test_a_sign_that_could_not_have_shown_is_not_missing(said: dict[str, list[Verdict]], name: str) -> None:
    """Frames that do not show all, its back, frames that are not there, what nobody located: no evidence."""
    site = f"95:{MISSING}"
    assert last_of(said["as it is"])[site].standing is Standing.MISSING
    assert site not in last_of(said[name])


# -- estimates by hand: one pole beside one sign of NVDB ----------------------------------------------------


def estimate(
    name: str,
    east: float,
    north: float,
    *codes: str,
    sigma: float = 0.2,
    state: State = State.REFINED,
    seen: tuple[int, int] = (SECOND_NS, 2 * SECOND_NS),
    object: str | None = None,  # noqa: A002 - as the source calls it
) -> Estimate:
    """An estimate so far from (E0, N0)."""
    latitude, longitude = geographic_from_utm33(np.array([E0 + east]), np.array([N0 + north]))
    return Estimate(
        *(name, object, "", ";".join(codes), "", state, float(latitude[0]), float(longitude[0]), 0.0),
        *(sigma**2 * np.eye(2), 0.3, 5, *seen, 3 * SECOND_NS, ("C1",)),
    )


def country(*codes: str) -> Country:
    """One Skiltpunkt, and another far enough away."""
    plates = tuple(Plate(20 + i, 1, code, "med") for i, code in enumerate(codes))
    far = Site(95, 2, 1, E0 + 300.0, N0, 0.2, True, (Plate(30, 1, "202", "med"),))
    return Country([Site(95, 1, 1, E0, N0, 0.2, True, plates), far])


@pytest.fixture(scope="module")
def engine(drive: Drive) -> LiveEngine:
    """An engine that knows no pose: what is held against NVDB are the estimates alone."""
    return LiveEngine(car_of(drive))


def lines(
    engine: LiveEngine, signs: Country, *steps: Estimate, together: bool = False
) -> list[tuple[str, str | None, str]]:
    """What is said as estimates come one after the other, each of pictures of its own, or of one."""
    check, found = LiveCheck(engine, signs, is_complete=True), list[Verdict]()
    for number, step in enumerate(steps):
        engine.shown = ((step.id, "foot"),)
        check.take(Arrival(3 * SECOND_NS, Frame("C1", 0 if together else number, SECOND_NS)), [])
    engine.shown = ()
    for step in steps:
        found += check.take(Arrival(3 * SECOND_NS, Frame("C1", 0, SECOND_NS)), [step])
    return [(one.id, None if one.was is None else one.was.value, one.standing.value) for one in found]


def test_a_sign_seen_from_afar_is_unchanged_until_it_turns_out_to_stand_elsewhere(engine: LiveEngine) -> None:
    """One frame finds the sign, twenty show that it was moved; the reason is of that kind."""
    afar = estimate("P", 3, 0, "202", sigma=6.0, state=State.FIRST)
    steps = afar, estimate("P", 3, 0, "202", sigma=0.3), estimate("P", 3, 0, "202", state=State.FINAL)
    assert lines(engine, country("202"), *steps) == [
        ("95:1", None, "unchanged"),
        ("95:1", "unchanged", "moved"),
        ("95:1", "moved", "moved"),
    ]
    check = LiveCheck(engine, country("202"), is_complete=True)
    moved = check.take(Arrival(1, Frame("C1", 0, 1)), [steps[2]])[0]
    assert isinstance(moved.why, Moved)
    properties = moved.feature()["properties"]
    assert properties["why"]["kind"] == "moved"
    assert properties["final"] is True
    assert properties["distance_m"] == pytest.approx(3.0, abs=0.01)


def test_a_drive_that_ends_far_from_a_sign_has_no_last_word_that_is_unlikely(engine: LiveEngine) -> None:
    """What 95 % of a long ellipse says is no verdict; what was said stays if it is likely, else it is not."""
    near = estimate("P", 0.2, 0, "202", sigma=1.0)
    ended = estimate("P", 8.1, 0, "202", sigma=3.8, state=State.FINAL)
    assert lines(engine, country("202"), near, ended) == [("95:1", None, "unchanged")]
    assert lines(engine, country("202"), ended) == []
    beyond = estimate("P", 3, 0, "202", sigma=0.3)
    assert lines(engine, country("202"), beyond, ended) == [
        ("95:1", None, "moved"),
        ("95:1", "moved", "expected"),
    ]


def test_a_new_sign_needs_more_than_one_frame(engine: LiveEngine) -> None:
    """What one frame places where NVDB has none is new when others agree, by the engine's id."""
    afar = estimate("P", 60, 0, "202", sigma=1.0, state=State.FIRST)
    assert lines(engine, country("202"), afar) == []
    assert lines(engine, country("202"), afar, estimate("P", 60, 0, "202")) == [("P", None, "new")]


def test_a_new_sign_that_proves_to_be_nvdb_s_is_taken_back(engine: LiveEngine) -> None:
    """The engine's id is withdrawn, NVDB's gets the verdict; and what was NVDB's may turn out to be new."""
    far, near = estimate("P", 25, 0, "202", sigma=0.5), estimate("P", 0.3, 0, "202")
    assert lines(engine, country("202"), far, near) == [
        ("P", None, "new"),
        ("95:1", None, "unchanged"),
        ("P", "new", "withdrawn"),
    ]
    assert lines(engine, country("202"), near, far) == [
        ("95:1", None, "unchanged"),
        ("P", None, "new"),
        ("95:1", "unchanged", "expected"),
    ]


def test_another_code_is_a_wrong_type_of_its_plate(engine: LiveEngine) -> None:
    """The plate's own id has the verdict; a plate that NVDB lacks has the pole's id and its code."""
    seen = estimate("P", 0.1, 0, "362.60", "808")
    assert lines(engine, country("362.50"), seen) == [
        ("P/808", None, "new"),
        ("96:20", None, "wrong_type"),
    ]


def test_a_track_that_was_lost_and_begun_anew_is_one_pole(engine: LiveEngine) -> None:
    """Two objects of one camera with the same plates at one place, that no picture shows both, are one."""
    later = estimate("Q", 2.2, 0, "202", sigma=0.6, seen=(5 * SECOND_NS, 6 * SECOND_NS))
    first = estimate("P", 0.1, 0, "202", sigma=0.6, state=State.FINAL)
    assert lines(engine, country("202"), first, later) == [("95:1", None, "unchanged")]
    again = estimate("P#2", 1.9, 0, "202", seen=(5 * SECOND_NS, 6 * SECOND_NS), object="P")
    met = estimate("P", 0.1, 0, "202", state=State.FINAL, object="P")
    assert [name for name, _, _ in lines(engine, country("202"), met, again)] == ["95:1", "95:1"]
    assert ("Q", None, "new") in lines(engine, country("202"), first, later, together=True)


def test_the_signs_about_the_car_are_those_of_the_mirror(synced_store: Path) -> None:
    """Whichever square the car is in, what is near it is what the whole mirror has there."""
    sites = sites_of(synced_store)
    tree, middle = SignTree(sites), np.mean([(site.east_m, site.north_m) for site in sites], axis=0)
    with Store.open(synced_store) as store:
        signs = MirrorAhead(store, CONFIG)
        for step in np.arange(-1500.0, 1500.0, 130.0):
            place = middle + step
            signs.move(place)
            assert signs.near(place[None], 150.0) == tree.near(place[None], 150.0)
            assert signs.is_mirrored(place[None])[0] == (tree.distance_m(place[None])[0] <= CONFIG.mirrored_m)
        signs.close()


def test_twin_live_check_says_verdicts_between_estimates(twin: Twin, sample: Path, synced: Path) -> None:
    """One GeoJSON feature a line; the drive that passes P12 finds its code to be another than NVDB's."""
    trip = sample / "trip_trondheim_2"
    answer = twin("live", "--replay", trip, "--speed", "max", "--check", "--store", synced)
    assert answer.code == 0
    said = [one for line in answer.out.splitlines() if "verdict" in (one := json.loads(line))["properties"]]
    assert {one["type"] for one in said} == {"Feature"}
    wrong = [one["properties"] for one in said if one["id"] == "96:1042600114"]
    assert (wrong[0]["verdict"], wrong[0]["was"]) == ("wrong_type", None)
    assert (wrong[-1]["skiltnummer_seen"], wrong[-1]["skiltnummer_nvdb"]) == ("362.50", "362.60")
    assert wrong[-1]["final"] is True
    assert wrong[-1]["why"]["kind"] == "wrong_type"


def test_twin_live_check_needs_signs(twin: Twin, sample: Path, empty: Store) -> None:
    """A store without NVDB's signs is refused at once, in a sentence that names the cure."""
    answer = twin("live", "--replay", sample / "trip_trondheim_2", "--check", "--store", empty.name)
    assert answer.code == 4
    assert "twin sync-nvdb" in answer.err
