"""The engine on the shipped sample: estimates that only what arrives decides, near the truth."""

from __future__ import annotations

import csv
import json
from itertools import islice

import numpy as np
import pytest
from command_line import Twin

from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.live.causal import Following
from geoloc.live.samples import Fix
from geoloc.locate.accuracy import nees
from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.errors import DriveError
from twin.live import Arrival, Estimate, Frame, LiveEngine, State, arrivals_of, car_of, played
from twin.live.features import line_of
from twin.samples.demo import sample_folder

TRIP = sample_folder() / "trip_trondheim"
SECOND_NS = 1_000_000_000


@pytest.fixture(scope="module")
def drive() -> Drive:
    """The sample's first trip."""
    return read_drive(TRIP)


def truth() -> dict[str, tuple[float, float]]:
    """Easting and northing of each pole."""
    with (sample_folder() / "truth.csv").open(encoding="utf-8") as file:
        return {
            row["object"]: (float(row["easting"]), float(row["northing"])) for row in csv.DictReader(file)
        }


def fed(drive: Drive, arrivals: list[Arrival]) -> tuple[LiveEngine, list[Estimate]]:
    """Feed an engine and end the drive."""
    engine, found = LiveEngine(car_of(drive)), list[Estimate]()
    for one in arrivals:
        found += engine.feed(one)
    return engine, found + engine.finish()


def test_silence_ends_what_was_in_view_and_the_position(drive: Drive) -> None:
    """When nothing arrives any more and time passes, poles become final, and the car's place is lost."""
    engine, found = LiveEngine(car_of(drive)), list[Estimate]()
    begin_ns = next(arrivals_of(drive)).at_ns
    for one in arrivals_of(drive):
        if one.at_ns > begin_ns + 12 * SECOND_NS:
            break
        found += engine.feed(one)
        heard_ns = one.at_ns
    in_view = {one.id for one in found} - {one.id for one in found if one.lasts}
    assert in_view
    assert engine.following is Following.FIXED
    final, followed = list[Estimate](), list[Following]()
    for i in range(1, 49):
        final += [one for one in engine.let_pass(heard_ns + i * SECOND_NS // 4) if one.lasts]
        followed.append(engine.following)
    assert [one.id for one in final if one.state is State.FINAL] == sorted(in_view)
    assert all(one.at_ns <= heard_ns + 9 * SECOND_NS for one in final)
    assert followed == sorted(followed, key=["fixed", "predicted", "lost"].index)
    assert 3 <= followed.count(Following.FIXED) <= 5
    assert 35 <= followed.count(Following.PREDICTED) <= 38
    assert followed[-1] is Following.LOST
    assert engine.finish() == []


def test_the_sample_live_is_located_to_decimetres(twin: Twin) -> None:
    """Each pole gets a first estimate, refined ones, and a final one whose ellipse holds the truth."""
    answer = twin("live", "--replay", str(TRIP), "--speed", "max")
    assert answer.code == 0
    every = [json.loads(line) for line in answer.out.splitlines()]
    features = [one for one in every if "state" in one["properties"]]
    cars = [one["properties"] for one in every if one["id"] == "car"]
    assert {one["gnss"] for one in cars[3:]} == {"fine"}
    assert all(one["sigma_major_m"] < 0.2 for one in cars[5:])
    poles, states = truth(), dict[str, list[str]]()
    for one in features:
        states.setdefault(one["id"], []).append(one["properties"]["state"])
    assert set(states) == set(poles)
    for said in states.values():
        assert said[0] == "first"
        assert said[-1] == "final"
        assert set(said[1:-1]) == {"refined"}
    off, error = [], []
    for one in features:
        about = one["properties"]
        if about["state"] != "final":
            continue
        east, north = poles[one["id"]]
        lon, lat = one["geometry"]["coordinates"]
        again = np.ravel(utm33_from_geographic(np.array([lat]), np.array([lon])))
        assert again == pytest.approx([about["easting"], about["northing"]], abs=0.002)
        error.append(np.hypot(about["easting"] - east, about["northing"] - north))
        off.append(error[-1] / about["major95_m"])
        assert about["n_sightings"] > 20
    assert np.median(error) < 0.1
    assert np.mean(np.array(off) < 1.0) >= 0.9
    assert "15 objects located" in answer.err


def test_only_what_arrives_decides(drive: Drive) -> None:
    """The same arrivals give the same lines, in whatever rhythm they are fed."""
    some = list(islice(arrivals_of(drive), 700))
    at_s, slept = [0.0], list[float]()

    def sleep(for_s: float) -> None:
        slept.append(for_s)
        at_s[0] += for_s

    again = list(played(some, 1.0, clock_s=lambda: at_s[0], sleep=sleep))
    assert again == some
    assert sum(slept) == pytest.approx((some[-1].at_ns - some[0].at_ns) / 1e9, abs=1e-3)
    lines = [[line_of(one) for one in fed(drive, one)[1]] for one in (some, again)]
    assert lines[0] == lines[1]
    assert len(lines[0]) > 20


def test_without_ids_every_pole_is_found(drive: Drive) -> None:
    """Detections that say nothing of their objects are followed through frames and cameras."""
    nameless = [
        one._replace(
            what=one.what._replace(
                detections=tuple(each._replace(object=None) for each in one.what.detections)
            )
        )
        if isinstance(one.what, Frame)
        else one
        for one in islice(arrivals_of(drive), 1300)
    ]
    _, found = fed(drive, nameless)
    final = [one for one in found if one.state is State.FINAL and np.trace(one.covariance_m2) < 0.1]
    place = np.stack(
        utm33_from_geographic(
            np.array([one.latitude_deg for one in final]), np.array([one.longitude_deg for one in final])
        ),
        axis=1,
    )
    poles = np.array(list(truth().values()))
    away = np.linalg.norm(place[:, None] - poles, axis=2)
    assert away.min(axis=1).max() < 1.0
    assert {f"P{i:02d}" for i in range(1, 6)} <= {list(truth())[i] for i in away.argmin(axis=1)}


@pytest.mark.slow
def test_lost_fixes_leave_estimates_with_larger_ellipses_and_the_engine_goes_on(drive: Drive) -> None:
    """Four seconds without a fix: the poles seen then are located less surely, later ones as before."""
    every = list(islice(arrivals_of(drive), 1500))
    begin_ns = every[0].at_ns + 9 * SECOND_NS
    lost = [
        one
        for one in every
        if not (isinstance(one.what, Fix) and begin_ns < one.at_ns < begin_ns + 4 * SECOND_NS)
    ]
    engine, found = fed(drive, lost)
    assert engine.following is Following.FIXED
    _, usual = fed(drive, every)
    size = [
        {one.id: float(np.sqrt(np.trace(one.covariance_m2))) for one in each if one.state is State.FINAL}
        for each in (found, usual)
    ]
    assert set(size[0]) == set(size[1])
    assert max(size[0][name] / size[1][name] for name in size[1]) > 1.3
    poles, squares = truth(), []
    for one in found:
        if one.state is State.FINAL:
            at = utm33_from_geographic(np.array([one.latitude_deg]), np.array([one.longitude_deg]))
            off = np.ravel(at) - poles[one.id]
            squares.append(float(nees(off[None], one.covariance_m2[None])[0]))
    assert np.mean(np.array(squares) < 5.991) > 0.8


def test_recorded_poses_are_refused(drive: Drive) -> None:
    """A drive without fixes says what locates it instead."""
    from dataclasses import replace

    with pytest.raises(DriveError, match="twin ingest-drive"):
        car_of(replace(drive, gnss=()))
