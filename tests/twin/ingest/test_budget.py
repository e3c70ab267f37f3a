"""Terms of the error budget that a drive states, and camera clocks that nobody measured."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command_line import Twin

from geoloc.locate.single_frame import ErrorBudget
from twin.cli.exit_codes import EXIT_USAGE
from twin.drives.drive import Drive
from twin.drives.frames.clocks import STATED_MS, StatedClock, computed, of_host
from twin.drives.frames.stamp_files import NO_STAMP
from twin.drives.read import read_drive
from twin.errors import ConfigError
from twin.ingest.budget import budget_of, clock_doubts
from twin.ingest.locate import locate_annotations, trajectory_of
from twin.samples.demo import sample_folder

USUAL = ErrorBudget()
START_NS = 1_781_078_400_000_000_000


@cache
def sample() -> Drive:
    """The sample's drive: a triggered camera, RTK."""
    return read_drive(sample_folder() / "trip_trondheim")


def test_measured_stamps_and_rtk_keep_the_usual_budget() -> None:
    """Nothing is widened where nothing is to be doubted."""
    assert sample().clock is None
    assert budget_of(sample(), None, {}) == USUAL


def test_what_is_asked_for_counts_before_what_the_drive_states() -> None:
    """Option, then drive.toml, then what the clock is taken as, then the usual."""
    drive = replace(
        sample(), errors={"boresight_deg": 0.1, "pixel_px": 3.0}, clock=StatedClock(STATED_MS, "so")
    )
    budget = budget_of(drive, None, {"pixel_px": 2.0})
    assert (budget.boresight_deg, budget.pixel_px) == (0.1, 2.0)
    assert budget.time_ms == pytest.approx(STATED_MS, rel=1e-4)
    assert budget_of(replace(drive, errors={"time_ms": 8.0}), None, {}).time_ms == 8.0
    assert budget_of(drive, USUAL, {"time_ms": 7.0}) == replace(USUAL, time_ms=7.0)


@pytest.mark.parametrize(
    ("errors", "said"), [({"boresight": 0.1}, "no error"), ({"time_ms": -1.0}, "cannot")]
)
def test_errors_that_there_are_not_are_refused(errors: dict[str, float], said: str) -> None:
    """One sentence with the name and what it must be."""
    with pytest.raises(ConfigError, match=said):
        budget_of(sample(), None, errors)


@pytest.mark.parametrize("text", ["boresight_deg", "boresight_deg=wide", "time=5"])
def test_error_option_that_is_wrong_is_a_usage_error(twin: Twin, text: str, tmp_path: Path) -> None:
    """No traceback, exit code 2, and nothing kept."""
    store = tmp_path / "t.db"
    drive = sample_folder() / "trip_trondheim"
    answer = twin("ingest-drive", drive, "--store", store, "--error", text)
    assert answer.code == EXIT_USAGE
    assert text.partition("=")[0] in answer.err
    assert not store.exists()


def test_stamps_that_were_counted_on_are_told_from_measured_ones() -> None:
    """Even to the microsecond from a whole second: nobody measured that. Jitter, or poses of them, do."""
    number = np.arange(300)
    even_ns = START_NS + np.round(number * 1e9 / 30.0).astype(np.int64) // 1000 * 1000
    gaps = np.where(number % 7 == 3, NO_STAMP, even_ns)
    for stamps in (even_ns, gaps):
        assert computed(stamps, "a.csv") is not None
    jitter_ns = np.random.default_rng(0).normal(0.0, 3e5, number.size).astype(np.int64)
    assert computed(even_ns + jitter_ns, "a.csv") is None
    assert computed(even_ns + 123_456_000, "a.csv") is None


def test_host_clock_that_is_off_widens_the_cameras_clock() -> None:
    """The cameras are stamped by the clock that stamped the fixes too late."""
    assert of_host(sample().gnss) is None
    late = tuple(replace(one, host_ns=one.host_ns + 900_000_000) for one in sample().gnss)
    clock = of_host(late)
    assert clock is not None
    assert clock.sigma_ms == pytest.approx(978.0, abs=10.0)


def test_stated_start_that_is_late_is_found_and_not_to_be_counted_twice() -> None:
    """The drive's bends say what was added to the clock; to state that too would use the drive twice."""
    stamps = {camera: ns + 1_000_000_000 for camera, ns in sample().frame_epoch_ns.items()}
    drive = replace(sample(), frame_epoch_ns=stamps, clock=StatedClock(STATED_MS, "its start is stated"))
    budget = budget_of(drive, None, {})
    sighted = locate_annotations(drive, trajectory_of(drive), method="adjusted", budget=budget)
    (doubt,) = clock_doubts(drive, budget, sighted.adjusted)
    assert sighted.adjusted is not None
    added = sighted.adjusted.time_offset_ms
    assert f"{added.value:+.0f} ± {added.sigma:.0f} ms were added" in doubt.sentence
    assert "nothing needs to be written" in doubt.sentence
    assert added.value == pytest.approx(-1000.0, abs=60.0)


def test_poses_without_sigmas_are_told(twin: Twin, tmp_path: Path) -> None:
    """`inspect` says what is taken and how to state it; what drive.toml states is taken as it is."""
    folder = tmp_path / "drive"
    shutil.copytree(sample_folder() / "trip_trondheim", folder)
    poses = trajectory_of(sample()).knots
    rows = [
        f"{poses.epoch_ns[i]},{poses.latitude_deg[i]:.10f},{poses.longitude_deg[i]:.10f},{poses.height_m[i]:.4f},"
        f"{poses.roll_deg[i]:.5f},{poses.pitch_deg[i]:.5f},{poses.heading_deg[i]:.5f}"
        for i in np.flatnonzero(poses.valid)
    ]
    header = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg"
    (folder / "poses.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    settings = (folder / "drive.toml").read_text(encoding="utf-8") + '[poses]\nfile = "poses.csv"\n'
    (folder / "drive.toml").write_text(settings, encoding="utf-8")
    assert "The poses state no sigmas: taken as" in " ".join(twin("inspect", folder).err.split())
    stated = "sigma_m = 0.1\nsigma_roll_pitch_deg = 0.2\nsigma_heading_deg = 0.3\n"
    (folder / "drive.toml").write_text(settings + stated, encoding="utf-8")
    track = read_drive(folder).poses
    assert track is not None
    assert (track.sigma_horizontal_m == 0.1).all()
    assert (track.sigma_heading_deg == 0.3).all()
    assert trajectory_of(read_drive(folder)).estimated is None
