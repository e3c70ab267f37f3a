"""Writers of simulated drives: the formats of the real car, and nothing lost on the way."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import defusedxml.ElementTree
import numpy as np
import pynmea2
import pytest

from geoloc.rig.rig import read_rig
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from twin.drives.read import read_drive
from twin.errors import DriveError
from twin.samples.write_drive import write_driveworks_trip

SENTENCE = re.compile(
    rb"\$GPGGA,\d{6}\.\d\d,\d{4}\.\d{7},N,\d{5}\.\d{7},E,"
    rb"4,14,1\.1,\d+\.\d\d,M,0\.0,M,0\.9,0246\*[0-9A-F]{2} \d{16}"
)


@pytest.fixture(scope="module")
def simulated() -> SimulatedDrive:
    """Three cameras, one pole, eleven seconds."""
    return simulate_drive(scenario("approach", 20.0), 8)


@pytest.fixture(scope="module")
def trip(simulated: SimulatedDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the drive, written as a DriveWorks trip."""
    folder = tmp_path_factory.mktemp("drives") / "trip"
    write_driveworks_trip(simulated, folder)
    return folder


def _tracks(path: Path) -> list[Element]:
    root = defusedxml.ElementTree.parse(path).getroot()
    assert root is not None
    return list(root.findall("track"))


def test_trip_reads_back_what_was_simulated(simulated: SimulatedDrive, trip: Path) -> None:
    """The reader gives every fix, stamp and pixel back, to the decimals of the formats, and skips nothing."""
    drive = read_drive(trip)
    assert drive.skipped == ()
    assert drive.annotations_complete
    for fixes, truth in zip(drive.gnss, simulated.gnss, strict=True):
        assert fixes.antenna == truth.antenna
        assert np.array_equal(fixes.epoch_ns, truth.epoch_ns)
        # Half a digit: 1e-7 minutes, 1 cm of height, 1 µs of the host's clock.
        assert fixes.latitude_deg == pytest.approx(truth.latitude_deg, abs=0.51e-7 / 60)
        assert fixes.longitude_deg == pytest.approx(truth.longitude_deg, abs=0.51e-7 / 60)
        assert fixes.height_m == pytest.approx(truth.height_m, abs=0.0051)
        assert np.abs(fixes.host_ns - truth.host_ns).max() <= 500
        assert set(fixes.quality) == {4}
    s, a = simulated.sightings, drive.annotations
    order = np.lexsort((s.object_index, s.frame, s.camera))
    found = np.lexsort((a.object, a.frame, a.camera))
    assert np.array_equal(a.camera[found], s.camera[order])
    assert np.array_equal(a.frame[found], s.frame[order])
    assert a.pixel_px[found] == pytest.approx(s.pixel_px[order], abs=0.0051)
    assert set(a.object) == {"P01"}
    assert set(a.skiltnummer) == {"362.50"}
    assert set(a.kind) == {"foot"}
    for camera in simulated.scenario.cameras:
        assert np.abs(drive.frame_epoch_ns[camera] - simulated.frame_host_ns[camera]).max() <= 500


def test_rig_file_holds_the_rig(simulated: SimulatedDrive, trip: Path) -> None:
    """The rig file gives the simulated rig back: mounting to 1e-9, lens exactly, mask and file names."""
    rig = read_rig(trip / "rig.json")
    assert list(rig.cameras) == list(simulated.rig.cameras)
    for name, camera in simulated.rig.cameras.items():
        read = rig.cameras[name]
        assert read.model == camera.model
        assert np.abs(read.rig_R_camera - camera.rig_R_camera).max() < 1e-9
        assert np.abs(read.rig_t_camera_m - camera.rig_t_camera_m).max() < 1e-9
        assert read.timestamps == camera.timestamps
        assert (read.ego_mask is None) == (camera.ego_mask is None)
        if read.ego_mask is not None and camera.ego_mask is not None:
            assert np.array_equal(read.ego_mask, camera.ego_mask)
    for name, antenna in simulated.rig.antennas.items():
        assert rig.antennas[name].rig_t_antenna_m == pytest.approx(antenna.rig_t_antenna_m, abs=1e-9)
        assert rig.antennas[name].file == antenna.file


def test_sentences_have_the_form_of_the_real_car(trip: Path) -> None:
    """Each line matches the recorder's form, its checksum is right, and it ends with CR LF."""
    lines = (trip / "gnss50_vehicle.bin").read_bytes().split(b"\r\n")
    assert lines.pop() == b""
    for line in lines:
        assert SENTENCE.fullmatch(line)
        pynmea2.parse(line.decode().partition(" ")[0], check=True)


def test_minutes_never_read_sixty(simulated: SimulatedDrive, tmp_path: Path) -> None:
    """A latitude a hair below a full degree rounds up to the degree, south and west get their letters."""
    gnss = simulated.gnss[0]
    n = gnss.epoch_ns.size
    edge = replace(
        gnss, latitude_deg=np.full(n, -(64.0 - 1e-12)), longitude_deg=np.full(n, -(9.0 + 0.5 / 60))
    )
    write_driveworks_trip(replace(simulated, gnss=(edge,)), tmp_path)
    line = (tmp_path / "gnss50_vehicle.bin").read_text(encoding="ascii").splitlines()[0]
    assert ",6400.0000000,S,00900.5000000,W," in line


def test_epochs_between_hundredths_keep_their_time(simulated: SimulatedDrive, tmp_path: Path) -> None:
    """A receiver at 8 Hz is not on whole hundredths: its sentences carry microseconds."""
    motion = replace(simulated.scenario.motion, gnss_rate_hz=8.0)
    drive = simulate_drive(replace(simulated.scenario, motion=motion), 8)
    write_driveworks_trip(drive, tmp_path)
    assert ",075959.125000," in (tmp_path / "gnss50_vehicle.bin").read_text(encoding="ascii")
    assert np.array_equal(read_drive(tmp_path).gnss[0].epoch_ns, drive.gnss[0].epoch_ns)


def test_annotations_count_from_the_corner(simulated: SimulatedDrive, trip: Path) -> None:
    """CVAT's points are half a pixel more than ours, one track an object, one point a key frame."""
    tracks = _tracks(trip / "C3_tricam120.xml")
    assert len(tracks) == 1
    points = tracks[0].findall("points")
    inside = [p for p in points if p.get("outside") == "0"]
    rows = simulated.sightings.camera == "C3_tricam120"
    frames = simulated.sightings.frame[rows]
    assert [int(p.get("frame", "")) for p in inside] == frames.tolist()
    x, y = (float(value) for value in inside[0].get("points", "").split(","))
    assert (x, y) == pytest.approx(simulated.sightings.pixel_px[rows][0] + 0.5, abs=0.0051)


def test_lost_object_comes_back_in_the_same_track(simulated: SimulatedDrive, tmp_path: Path) -> None:
    """A track is outside from where its object is hidden until it is seen again, and at its end."""
    s = simulated.sightings
    keep = np.ones(s.frame.size, dtype=bool)
    rows = np.flatnonzero(s.camera == "C2_tricam60")
    keep[rows[4:7]] = keep[rows[-2:]] = False
    hidden = replace(s, **{f.name: getattr(s, f.name)[keep] for f in fields(s)})
    write_driveworks_trip(replace(simulated, sightings=hidden), tmp_path)
    points = _tracks(tmp_path / "C2_tricam60.xml")[0].findall("points")
    state = {int(p.get("frame", "")): p.get("outside") for p in points}
    assert state[int(s.frame[rows[4]])] == "1"
    assert int(s.frame[rows[5]]) not in state
    assert state[int(s.frame[rows[7]])] == "0"
    assert (max(state), state[max(state)]) == (int(s.frame[rows[-2]]), "1")
    assert read_drive(tmp_path).annotations.frame.size == keep.sum()


def test_folder_that_is_a_file_is_refused(simulated: SimulatedDrive, tmp_path: Path) -> None:
    """Writing onto a file is one clear error, and the file is left alone."""
    (tmp_path / "drive").write_text("mine", encoding="utf-8")
    with pytest.raises(DriveError, match="cannot be written to"):
        write_driveworks_trip(simulated, tmp_path / "drive")
    assert (tmp_path / "drive").read_text(encoding="utf-8") == "mine"
