"""Drives that do not fit themselves, and drives that cannot show that a sign is missing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from geoloc.adjustment.result import AdjustmentDoubt
from geoloc.doubts import Doubt
from geoloc.locate.single_frame import ErrorBudget
from geoloc.trajectory.trajectory import Trajectory
from twin.drives.annotations.gather import only
from twin.drives.drive import Drive
from twin.drives.folder.notes import DriveDoubt, SkipKind, Skipped
from twin.drives.objects.identify import id_warnings
from twin.drives.read import read_drive
from twin.ingest.locate import locate_annotations, trajectory_of
from twin.ingest.misfits import absence_gap, clocks_apart, misfits_of
from twin.samples.demo import sample_folder

WIDE, TELE = "C3_tricam120", "C2_tricam60"


@cache
def sample_drive() -> tuple[Drive, Trajectory]:
    """The sample's drive as it is."""
    drive = read_drive(sample_folder() / "trip_trondheim")
    return drive, trajectory_of(drive)


def drawn(drive: Drive, pixel_px: np.ndarray) -> Drive:
    """The drive with its annotations drawn elsewhere."""
    return replace(drive, annotations=replace(drive.annotations, pixel_px=pixel_px))


def misfits(drive: Drive) -> list[str]:
    """In which ways the drive does not fit itself."""
    sighted = locate_annotations(drive, sample_drive()[1], method="adjusted")
    return [misfit.what for misfit in misfits_of(drive, sighted, ErrorBudget())]


@pytest.mark.parametrize("noise_px", [0.0, 3.0])
def test_sound_drive_fits_itself(noise_px: float) -> None:
    """An annotator who is twice as rough as stated gives no alarm, and the drive shows what is missing."""
    drive, trajectory = sample_drive()
    pixel_px = drive.annotations.pixel_px
    rough = drawn(drive, pixel_px + np.random.default_rng(1).normal(0, noise_px, pixel_px.shape))
    assert misfits(rough) == []
    assert absence_gap(rough, locate_annotations(rough, trajectory, method="adjusted")) == ""


def test_camera_that_is_off_towards_its_edge_is_named() -> None:
    """One in ten of a camera's points, far out at most objects, lies 40 px off: the camera is named."""
    drive, _ = sample_drive()
    notes = drive.annotations
    out_px = np.abs(notes.pixel_px[:, 0] - 959.5)
    wide = notes.camera == WIDE
    far_out = wide & (out_px > np.quantile(out_px[wide], 0.9))
    assert np.unique(notes.object[far_out]).size > 8
    bent = notes.pixel_px + np.where(far_out, 40.0, 0.0)[:, None]
    assert misfits(drawn(drive, bent)) == [f"{WIDE} does not fit"]


def test_annotations_of_nowhere_are_too_many_outliers() -> None:
    """A fifth of the points anywhere in the picture: the drive says how many contradict the others."""
    drive, _ = sample_drive()
    rng = np.random.default_rng(2)
    pixel_px = drive.annotations.pixel_px.copy()
    lost = rng.random(len(pixel_px)) < 0.2
    pixel_px[lost] = rng.uniform([0, 650], [1900, 1200], (lost.sum(), 2))
    assert any("contradict the others" in what for what in misfits(drawn(drive, pixel_px)))


@pytest.mark.slow
def test_late_clock_of_one_camera_is_named_and_no_id_doubted() -> None:
    """One camera 300 ms late: one sentence names the clock that fits, in place of many on ids."""
    drive, trajectory = sample_drive()
    stamps = dict(drive.frame_epoch_ns)
    stamps[TELE] = stamps[TELE] + 300_000_000
    late = replace(drive, frame_epoch_ns=stamps)
    doubts = id_warnings(late, trajectory)
    assert len(doubts) == 1
    assert doubts[0].kind is DriveDoubt.CAMERAS_DISAGREE
    (named,) = clocks_apart(doubts, late, trajectory, ErrorBudget())
    assert f"{TELE} alone fits the track with -3" in named.sentence
    assert WIDE not in named.sentence
    (by_second,) = clocks_apart(doubts, late, trajectory, ErrorBudget(time_ms=1000.0))
    assert f"{TELE} alone fits the track with -3" in by_second.sentence
    assert WIDE not in by_second.sentence
    sighted = locate_annotations(late, trajectory, method="adjusted")
    assert "its cameras do not agree with one another" in [
        misfit.what for misfit in misfits_of(late, sighted, ErrorBudget(), doubts)
    ]


def test_annotations_at_half_size_show_nothing_missing() -> None:
    """With ids of each camera hardly any of them is located, and the drive says so."""
    drive, trajectory = sample_drive()
    some = np.isin(drive.annotations.object, np.unique(drive.annotations.object)[:7])
    notes = only(drive.annotations, some)
    ids = np.char.add(notes.camera, notes.object)
    half = replace(drive, annotations=replace(notes, object=ids, pixel_px=notes.pixel_px / 2))
    gap = absence_gap(half, locate_annotations(half, trajectory, method="adjusted"))
    assert gap.endswith(f" of 206 annotations of {TELE} could be located")


@pytest.mark.parametrize(
    ("kind", "count", "gap"),
    [
        (SkipKind.UNUSABLE, 300, "300 of 844 annotations in C3_tricam120.xml were left out"),
        (SkipKind.UNUSABLE, 100, ""),
        (SkipKind.REPEATED, 500, ""),
        (SkipKind.OTHER, 500, ""),
        (SkipKind.DAMAGED_FILE, 2, "2 of its annotation files are damaged"),
    ],
)
def test_what_was_left_out_may_be_the_missing_sign(kind: SkipKind, count: int, gap: str) -> None:
    """Annotations that were not read may be of any sign, repeats are none: the kind decides, no wording."""
    drive, trajectory = sample_drive()
    sighted = locate_annotations(drive, trajectory, method="single-frame")
    less = replace(drive, skipped=(Skipped("reworded", "C3_tricam120.xml", count, "reworded", kind),))
    assert absence_gap(less, sighted) == gap


def test_reworded_doubts_are_the_same_misfits() -> None:
    """What an adjustment is doubted for is told by the kind: other words change no verdict on the drive."""
    drive, trajectory = sample_drive()
    located = locate_annotations(drive, trajectory, method="adjusted")
    assert located.adjusted is not None
    doubts = tuple(Doubt(kind, f"reworded {kind}") for kind in AdjustmentDoubt)
    doubted = replace(located, adjusted=replace(located.adjusted, doubts=doubts))
    clock, shutter = misfits_of(drive, doubted, ErrorBudget())
    assert (clock.what[:19], clock.sentence) == ("its camera clock is", "reworded clock")
    assert (shutter.what, shutter.sentence) == ("its rolling shutter cannot be", "reworded shutter")
