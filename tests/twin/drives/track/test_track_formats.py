"""One drive, recorded in every format: the same positions of signs come out."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from track_writers import (
    Recorded,
    Ros,
    S,
    gps_tags,
    gpx_document,
    gpx_point,
    jpeg,
    sbp_recording,
)

from geoloc.earth.geodesy import enu_offset
from twin.drives.folder.drive_toml import read_settings
from twin.drives.read import read_drive
from twin.errors import DriveError
from twin.ingest.ingest import ingest_drive
from twin.store import schema
from twin.store.store import Store


def refitted(recorded: Recorded, folder: Path, files: dict[str, bytes], toml: str = "") -> Path:
    """Copy the drive with other recordings in place of its NMEA."""
    shutil.copytree(recorded.trip, folder, ignore=shutil.ignore_patterns("gnss*"))
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    settings = folder / "drive.toml"
    settings.write_text(settings.read_text(encoding="utf-8") + toml, encoding="utf-8")
    return folder


def estimates(folder: Path, store: Path) -> dict[str, tuple[float, float]]:
    """Easting and northing of each object, by name."""
    with Store.open(store) as opened:
        ingest_drive(opened, folder)
        rows = opened.rows(sa.select(schema.estimate))
    return {row["object"]: (row["east_m"], row["north_m"]) for row in rows}


def of_antennas(
    recorded: Recorded, write: Callable[[Any], bytes], suffix: str
) -> tuple[dict[str, bytes], str]:
    """A recording for each antenna, and the [gnss] table that names them."""
    files = {f"{one.antenna.partition(':')[0]}.{suffix}": write(one) for one in recorded.fixes}
    table = zip((one.antenna for one in recorded.fixes), files, strict=True)
    return files, "[gnss]\nfiles = { " + ", ".join(f'"{a}" = "{f}"' for a, f in table) + " }\n"


def topic_of(antenna: str) -> str:
    """Topic of an antenna."""
    return "/" + antenna.partition(":")[0] + "/fix"


def bag(recorded: Recorded, ros: Ros, path: Path, compression: str = "") -> Path:
    """Both antennas in one recording."""
    messages = [
        (topic_of(one.antenna), host_ns, ros.fix(epoch_ns, latitude, longitude, height))
        for one in recorded.fixes
        for epoch_ns, host_ns, latitude, longitude, height in zip(
            *(
                getattr(one, name).tolist()
                for name in ("epoch_ns", "host_ns", "latitude_deg", "longitude_deg", "height_m")
            ),
            strict=True,
        )
    ]
    return ros.write(path, sorted(messages, key=lambda message: message[1]), compression)


def in_one(recorded: Recorded, name: str) -> str:
    """The [gnss] table of both antennas in one recording."""
    antennas = [one.antenna for one in recorded.fixes]
    files = ", ".join(f'"{antenna}" = "{name}"' for antenna in antennas)
    topics = ", ".join(f'"{antenna}" = "{topic_of(antenna)}"' for antenna in antennas)
    return f"[gnss]\nfiles = {{ {files} }}\ntopics = {{ {topics} }}\n"


@pytest.fixture(scope="module")
def nmea(recorded: Recorded, tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[float, float]]:
    """What the NMEA recording gives."""
    return estimates(recorded.trip, tmp_path_factory.mktemp("store") / "twin.db")


def assert_same(found: dict[str, tuple[float, float]], nmea: dict[str, tuple[float, float]]) -> None:
    """The fixes are the same to the last digit: less than a micrometre apart."""
    assert found.keys() == nmea.keys()
    assert len(found) == 1
    for name, place in nmea.items():
        assert found[name] == pytest.approx(place, abs=1e-6)


def test_sbp_recordings_give_the_same_estimate(
    recorded: Recorded, nmea: dict[str, tuple[float, float]], tmp_path: Path
) -> None:
    """Two Duros that write SBP in place of NMEA."""
    files, table = of_antennas(recorded, sbp_recording, "sbp")
    assert_same(estimates(refitted(recorded, tmp_path / "sbp", files, table), tmp_path / "twin.db"), nmea)


@pytest.mark.parametrize(("version", "compression"), [(1, "lz4"), (2, "zstd"), (2, "db3")])
def test_ros_recordings_give_the_same_estimate(
    recorded: Recorded, nmea: dict[str, tuple[float, float]], tmp_path: Path, version: int, compression: str
) -> None:
    """One bag, MCAP or database with a topic an antenna; of ROS 2 its folder is named."""
    name = "run.bag" if version == 1 else "run"
    folder = refitted(recorded, tmp_path / "ros", {}, in_one(recorded, name))
    bag(recorded, Ros(version), folder / name, compression)
    assert_same(estimates(folder, tmp_path / "twin.db"), nmea)


def test_ros_recording_is_hashed_into_the_drives_id(recorded: Recorded, tmp_path: Path) -> None:
    """The same recording is the same drive; another one is not."""
    folder = refitted(recorded, tmp_path / "ros", {}, in_one(recorded, "run.bag"))
    path = bag(recorded, Ros(1), folder / "run.bag")
    first, again = read_drive(folder), read_drive(folder)
    assert (first.drive_id, first.content_sha256) == (again.drive_id, again.content_sha256)
    path.unlink()
    bag(recorded, Ros(1), path, "bz2")
    other = read_drive(folder)
    assert other.drive_id != first.drive_id
    np.testing.assert_array_equal(other.gnss[0].epoch_ns, first.gnss[0].epoch_ns)


def one_antenna(recorded: Recorded, folder: Path, name: str, content: bytes) -> Path:
    """The drive with a rig of one antenna that names no file, and one recording to be found."""
    refitted(recorded, folder, {name: content})
    rig = json.loads((folder / "rig.json").read_text(encoding="utf-8"))
    sensors = rig["rig"]["sensors"]
    antennas = [sensor for sensor in sensors if sensor["protocol"].startswith("gps")]
    antennas[0]["parameter"] = ""
    rig["rig"]["sensors"] = [sensor for sensor in sensors if sensor not in antennas[1:]]
    (folder / "rig.json").write_text(json.dumps(rig), encoding="utf-8")
    return folder


def recordings(recorded: Recorded) -> dict[str, bytes]:
    """The first antenna's fixes in every format that is one file of bytes."""
    one = recorded.drive.gnss[0]
    rows = list(zip(one.epoch_ns.tolist(), one.latitude_deg, one.longitude_deg, one.height_m, strict=True))
    return {
        "a.log": (recorded.trip / recorded.drive.rig.antennas[one.antenna].file).read_bytes(),  # type: ignore[operator]
        "a.raw": sbp_recording(one),
        "a.gpx": gpx_document(gpx_point(*row) for row in rows),
    }


@pytest.mark.parametrize("name", ["a.log", "a.raw", "a.gpx"])
def test_recording_of_one_antenna_is_found_by_its_content(
    recorded: Recorded, tmp_path: Path, name: str
) -> None:
    """No [gnss] table, no name in the rig: the only recording is that of the only antenna."""
    drive = read_drive(one_antenna(recorded, tmp_path / "trip", name, recordings(recorded)[name]))
    (fixes,), truth = drive.gnss, recorded.drive.gnss[0]
    assert np.abs(fixes.epoch_ns - truth.epoch_ns).max() < 1000
    east, north = enu_offset(truth.latitude_deg, truth.longitude_deg, fixes.latitude_deg, fixes.longitude_deg)
    assert np.hypot(east, north).max() < 2e-4  # NMEA's seventh decimal of a minute
    assert fixes.antenna == truth.antenna


def ros_run(recorded: Recorded, path: Path) -> int:
    """Write the first antenna's fixes as a ROS 2 recording; return how many there are."""
    ros, one = Ros(2), recorded.drive.gnss[0]
    place = (float(one.latitude_deg[0]), float(one.longitude_deg[0]), float(one.height_m[0]))
    ros.write(path, [("/fix", t, ros.fix(t, *place)) for t in one.epoch_ns.tolist()])
    return len(one.epoch_ns)


def test_folder_that_is_a_ros_2_recording_is_a_drive(recorded: Recorded, tmp_path: Path) -> None:
    """metadata.yaml and the parts lie beside rig and annotations."""
    folder = one_antenna(recorded, tmp_path / "trip", "notes.txt", b"")
    n_fixes = ros_run(recorded, tmp_path / "bag")
    for file in (tmp_path / "bag").iterdir():
        shutil.move(file, folder / file.name)
    assert len(read_drive(folder).gnss[0].epoch_ns) == n_fixes


def test_ros_2_recording_in_a_folder_of_its_own_is_found(recorded: Recorded, tmp_path: Path) -> None:
    """As ``ros2 bag record`` leaves it; with two antennas drive.toml must say whose it is."""
    folder = one_antenna(recorded, tmp_path / "trip", "notes.txt", b"")
    n_fixes = ros_run(recorded, folder / "run")
    assert len(read_drive(folder).gnss[0].epoch_ns) == n_fixes
    shutil.copy(recorded.trip / "rig.json", folder / "rig.json")
    with pytest.raises(DriveError, match=r"run is a GNSS recording, but not which antenna's"):
        read_drive(folder)


@pytest.mark.parametrize("named", [True, False])
def test_pictures_with_positions_are_an_antenna(recorded: Recorded, tmp_path: Path, named: bool) -> None:
    """A folder of pictures named under [gnss], or pictures in the drive folder and no other recording."""
    one = recorded.drive.gnss[0]
    seconds = np.arange(one.epoch_ns[0] // S + 1, one.epoch_ns[-1] // S + 1) * S
    at = np.searchsorted(one.epoch_ns, seconds)
    pictures = {}
    for i, t in zip(at.tolist(), seconds.tolist(), strict=True):
        clock = (float(t // S // 3600 % 24), float(t // S // 60 % 60), float(t // S % 60))
        date = str(np.datetime64(t, "ns"))[:10].replace("-", ":")
        tags = gps_tags(float(one.latitude_deg[i]), float(one.longitude_deg[i]), 100.0, clock, date)
        pictures[f"{'pictures/' if named else ''}p{i:04d}.jpg"] = jpeg(tags)
    folder = one_antenna(recorded, tmp_path / "trip", "notes.txt", b"")
    for name, content in pictures.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    if named:
        settings = (folder / "drive.toml").read_text(encoding="utf-8")
        table = f'[gnss]\nfiles = {{ "{one.antenna}" = "pictures" }}\n'
        (folder / "drive.toml").write_text(settings + table, encoding="utf-8")
    assert read_drive(folder).gnss[0].epoch_ns.tolist() == seconds.tolist()


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('[poses]\nfile = "a.log"', r"a\.log is NMEA, which says where an antenna was.*under \[gnss\]"),
        ('[poses]\nfile = "a.gpx"', r"a\.gpx is GPX, which says where an antenna was"),
        ('[poses]\nfile = "a.raw"', r"a\.raw holds no usable attitude"),
        (
            '[gnss]\nfiles = { "gnss50:vehicle" = "poses.csv" }',
            r"poses\.csv holds full poses: name it under \[poses\]",
        ),
        (
            '[gnss]\nfiles = { "gnss50:vehicle" = "a.log" }\ntopics = { gnss50 = "/fix" }',
            r"a topic of the antenna gnss50, but the recordings are those of gnss50:vehicle",
        ),
        ('[gnss]\nfiles = { "gnss50:vehicle" = "b.nmea" }', r"b\.nmea is not in the drive folder"),
        ('[gnss]\nfiles = { "gnss50:vehicle" = "empty" }', r"empty is not in the drive folder"),
        ('[gnss]\nfiles = { "gnss50:vehicle" = "../a.mcap" }', r"\.\./a\.mcap lies outside the drive folder"),
    ],
)
def test_track_of_the_wrong_kind_is_refused_with_the_cure(
    recorded: Recorded, tmp_path: Path, table: str, message: str
) -> None:
    """What it is, and where it belongs."""
    poses = b"time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg\n1,2,3,4,5,6,7\n"
    folder = refitted(recorded, tmp_path / "drive", recordings(recorded) | {"poses.csv": poses}, table)
    with pytest.raises(DriveError, match=message):
        read_drive(folder)


def test_no_track_at_all_names_the_formats(recorded: Recorded, tmp_path: Path) -> None:
    """A rig without antennas and a folder without recordings."""
    folder = one_antenna(recorded, tmp_path / "drive", "notes.txt", b"nothing")
    with pytest.raises(DriveError, match=r"holds no GNSS recording .NMEA, SwiftNav SBP, GPX.*and no poses"):
        read_drive(folder)


def test_stated_sigmas_reach_the_fixes(recorded: Recorded, tmp_path: Path) -> None:
    """Every optional column is as long as the fixes."""
    files, table = of_antennas(recorded, sbp_recording, "sbp")
    for fixes in read_drive(refitted(recorded, tmp_path / "drive", files, table)).gnss:
        assert {len(getattr(fixes, f.name)) for f in fields(fixes) if f.name != "antenna"} == {
            len(fixes.epoch_ns)
        }


def test_recording_that_is_larger_than_its_cap_is_refused(
    recorded: Recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may be larger than other files, but not without end."""
    folder = refitted(recorded, tmp_path / "ros", {}, in_one(recorded, "run.bag"))
    bag(recorded, Ros(1), folder / "run.bag")
    monkeypatch.setattr("twin.drives.folder.files.MAX_RECORDING_BYTES", 1000)
    with pytest.raises(DriveError, match=r"run\.bag is .* GB that a recording may have: cut out the topics"):
        read_drive(folder)


def test_part_of_a_recording_that_leads_outside_is_refused(recorded: Recorded, tmp_path: Path) -> None:
    """A link in a ROS 2 folder to a file elsewhere."""
    folder = refitted(recorded, tmp_path / "ros", {}, in_one(recorded, "run"))
    made = bag(recorded, Ros(2), tmp_path / "elsewhere")
    (folder / "run").mkdir()
    for file in made.iterdir():
        (folder / "run" / file.name).symlink_to(file)
    with pytest.raises(DriveError, match="outside the drive folder"):
        read_drive(folder)


def test_ros_2_folder_of_packed_files_says_to_unpack_them(recorded: Recorded, tmp_path: Path) -> None:
    """Compression of whole files leaves .db3.zstd."""
    files = {"run/metadata.yaml": b"", "run/run_0.db3.zstd": b""}
    folder = refitted(recorded, tmp_path / "ros", files, in_one(recorded, "run"))
    with pytest.raises(DriveError, match=r"run is a ROS 2 recording without .mcap or .db3 files: unpack"):
        read_drive(folder)


def test_file_of_no_known_format_names_the_formats(recorded: Recorded, tmp_path: Path) -> None:
    """A recording that is named under [gnss] but is a picture of a cat."""
    table = '[gnss]\nfiles = { "gnss50:vehicle" = "cat.raw" }'
    folder = refitted(recorded, tmp_path / "drive", {"cat.raw": b"\x89PNG" * 99}, table)
    with pytest.raises(
        DriveError, match=r"cat\.raw holds no usable GNSS fix.*looks like none of NMEA, SwiftNav"
    ):
        read_drive(folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[poses]\nfile = 'a'\nlever_arm = [1, 2]", r"poses\.lever_arm = .*x forward, y left, z up"),
        (
            "[poses]\nfile = 'a'\ntopics = { place = '/fix' }",
            r"topics\.place: the nearest known one",
        ),
        ("[gnss]\ntopics = { left = 3 }", r"gnss\.topics\.left = 3"),
    ],
)
def test_track_settings_that_are_wrong_are_refused(text: str, message: str) -> None:
    """The key, and what it must be."""
    with pytest.raises(DriveError, match=message):
        read_settings(text.encode())
