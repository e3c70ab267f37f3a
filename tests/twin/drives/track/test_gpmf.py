"""GoPro's own track: fixes, their times and their sigmas, out of the data stream of a video."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from small_camera import gps5_packet, gps9_packet, gyro_packet, write_video

from geoloc.rig.rig import Rig
from twin.drives.folder.drive_toml import DriveSettings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import ReadingNotes
from twin.drives.track.formats.gpmf import start_by_gps
from twin.drives.track.formats.recording import Recording
from twin.drives.track.read import read_track
from twin.errors import DriveError

NS = 1_000_000_000
START_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * NS
STAMPS = START_NS + np.arange(90, dtype=np.int64) * NS // 30
LATE_NS = 40_000_000


def place(k: int) -> tuple[float, float, float]:
    """Northwards, 1 m a fix."""
    return 63.41 + k * 9e-6, 10.45, 60.0


def video(folder: Path, packets: list[bytes]) -> Recording:
    """A video of three seconds with one packet a second."""
    write_video(
        folder / "GX010001.MP4",
        STAMPS,
        START_NS,
        data=[(1000 * k, packet) for k, packet in enumerate(packets)],
    )
    return Recording(DriveFolder(folder), "GX010001.MP4")


def fixes_of(recording: Recording):  # type: ignore[no-untyped-def]
    """Fixes as the drive has them."""
    settings = DriveSettings(gnss={"own": recording.name})
    (fixes,) = read_track(recording.folder, settings, Rig({}, {}, "rig"), ReadingNotes(None)).gnss
    return fixes


def test_fixes_that_share_a_packets_time_are_spread_to_the_next(tmp_path: Path) -> None:
    """18 fixes a second of a HERO5: the k-th is k / 18 s after its packet's time; one without fix is left."""
    first_ns = START_NS + LATE_NS
    packets = [gps5_packet(first_ns + s * NS, [place(18 * s + k) for k in range(18)]) for s in (0, 1)]
    packets.append(gps5_packet(START_NS + LATE_NS + 2 * NS, [place(40)], fix=0))
    recording = video(tmp_path, packets)
    fixes = fixes_of(recording)
    assert fixes.epoch_ns.size == 36
    expected = START_NS + LATE_NS + np.arange(36) * NS / 18
    np.testing.assert_allclose(fixes.epoch_ns - START_NS, expected - START_NS, atol=1000)
    np.testing.assert_allclose(fixes.latitude_deg, [place(k)[0] for k in range(36)], atol=1e-7)

    np.testing.assert_allclose(fixes.sigma_horizontal_m, 1.5 * 1.8)
    assert (fixes.quality == 1).all()
    start = start_by_gps(recording)
    assert start is not None
    assert start.epoch_ns - START_NS == pytest.approx(LATE_NS, abs=1_000_000)
    assert start.sigma_s == pytest.approx(0.3)


def test_fixes_with_their_own_times_keep_them(tmp_path: Path) -> None:
    """10 fixes a second of a HERO11, each with its day and second."""
    times = [START_NS + k * NS // 10 for k in range(30)]
    rows = [(t, place(k)) for k, t in enumerate(times)]
    fixes = fixes_of(video(tmp_path, [gps9_packet(rows[k : k + 10]) for k in (0, 10, 20)]))
    np.testing.assert_allclose(fixes.epoch_ns - START_NS, np.array(times) - START_NS, atol=1_000_000)
    assert np.ptp(fixes.latitude_deg) == pytest.approx(29 * 9e-6, abs=1e-7)


@pytest.mark.parametrize("cut", [3, 9, 40, 100])
def test_a_damaged_packet_costs_itself_alone(tmp_path: Path, cut: int) -> None:
    """A packet that breaks off, wherever, is left out, and the others stay."""
    whole = [gps5_packet(START_NS + s * NS, [place(18 * s + k) for k in range(18)]) for s in range(3)]
    fixes = fixes_of(video(tmp_path, [whole[0], whole[1][:cut], whole[2]]))
    assert fixes.epoch_ns.size == 36


def test_data_without_a_receiver_has_no_start(tmp_path: Path) -> None:
    """A video whose camera has a gyro and no GPS says nothing of its start."""
    assert start_by_gps(video(tmp_path, [gyro_packet([(0.0, 0.0, 0.1)] * 20)])) is None


def test_without_reception_one_sentence_says_so(tmp_path: Path) -> None:
    """A camera that never had a fix is refused with the cure."""
    recording = video(tmp_path, [gps5_packet(START_NS, [place(0)], fix=0)])
    assert start_by_gps(recording) is None
    with pytest.raises(DriveError, match=r"GX010001\.MP4 holds no usable GNSS fix .*no fix.*switch GPS on"):
        fixes_of(recording)
