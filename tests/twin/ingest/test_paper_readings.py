"""The paper's method on drives: a receiver's own heading, and the readings that a user asks for."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from pathlib import Path

import numpy as np
import pytest

from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from twin.errors import ConfigError
from twin.ingest.ingest import ingest_drive
from twin.reports.evaluation import evaluate
from twin.reports.truth import Truth
from twin.samples.write_drive import write_driveworks_trip
from twin.store.store import Store

SECOND = "gnss52:vehicle"


def standing(folder: Path) -> SimulatedDrive:
    """A car that stands from the first fix on; its one receiver tells a heading behind every other fix."""
    drive = simulate_drive(scenario("still"), 4)
    own = drive.gnss[0]
    still = own.epoch_ns > own.epoch_ns[-1] - 5_600_000_000
    columns = ("epoch_ns", "host_ns", "latitude_deg", "longitude_deg", "height_m", "quality")
    fixes = replace(own, **{name: getattr(own, name)[still] for name in columns}, **_NO_OPTIONAL)
    rig = replace(drive.rig, antennas={own.antenna: drive.rig.antennas[own.antenna]})
    write_driveworks_trip(replace(drive, gnss=(fixes,), rig=rig), folder)
    recording = folder / "gnss50_vehicle.bin"
    body = f"GPHDT,{drive.poses.heading_deg[-1] % 360.0:.3f},T"
    checksum = reduce(lambda total, byte: total ^ byte, body.encode(), 0)
    lines = recording.read_text().splitlines()
    said = [f"{line}\n${body}*{checksum:02X}" if i % 2 else line for i, line in enumerate(lines)]
    recording.write_text("\n".join(said) + "\n")
    return drive


_NO_OPTIONAL = {
    name: np.empty(0)
    for name in (
        *("sigma_horizontal_m", "sigma_vertical_m", "heading_deg"),
        *("heading_sigma_deg", "velocity_mps", "velocity_sigma_mps"),
    )
}


def test_standing_car_is_located_by_the_headings_of_its_receiver(empty: Store, tmp_path: Path) -> None:
    """Every sighting has a position although the car never moved, and the poles stand where they do."""
    drive = standing(tmp_path / "trip")
    report = ingest_drive(empty, tmp_path / "trip", method="paper")
    assert report.n_located > 0.95 * report.n_sightings > 100
    places = zip(drive.objects.object, drive.objects.east_utm33_m, drive.objects.north_utm33_m, strict=True)
    (paper,) = evaluate(empty, [Truth(str(name), "", float(e), float(n)) for name, e, n in places]).methods
    assert paper.objects.n == 3
    assert paper.objects.max < 3.0


def test_readings_are_those_asked_for_and_told(empty: Store, trip: Path) -> None:
    """The other antenna is 1.1 m aside: each object moves by that, and hardly if both start from the axle."""
    start = {"start": "rear-axle"}
    found = []
    for asked in ({}, {"antenna": SECOND}, start, {"antenna": SECOND, **start}):
        report = ingest_drive(empty, trip, method="paper", paper=asked)
        frame = empty.estimates("paper")
        found.append(np.column_stack([frame.geometry.x, frame.geometry.y]))
    told = f"The paper's method was read with antenna={SECOND}, start=rear-axle."
    assert report.warnings[-1] == told
    first, second, of_axle, of_axle_too = found
    assert np.hypot(*(second - first).T) == pytest.approx(1.11, abs=0.25)
    assert np.median(np.hypot(*(of_axle_too - of_axle).T)) < 0.1


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"radius": "1"}, "knows no radius"),
        ({"distance": "far"}, "write rear-axle or camera or ray"),
        ({"fov": "60"}, "write calibrated or nominal"),
        ({"fov.C9": "60"}, "no such camera"),
        ({"fov.C2_tricam60": "wide"}, "between 0 and 360"),
        ({"start": "here"}, "write antenna or rear-axle"),
        ({"antenna": "roof"}, "no such antenna; it has gnss50"),
    ],
)
def test_wrong_readings_are_one_sentence(empty: Store, trip: Path, asked: dict[str, str], words: str) -> None:
    """What, where and cure; and they matter to no other method."""
    with pytest.raises(ConfigError, match=words):
        ingest_drive(empty, trip, method="paper", paper=asked)
    with pytest.raises(ConfigError, match="--method paper alone"):
        ingest_drive(empty, trip, paper=asked)
