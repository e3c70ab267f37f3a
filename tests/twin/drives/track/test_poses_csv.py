"""Pose files."""

from __future__ import annotations

import numpy as np
import pytest
from left_out import counts

from twin.drives.track.formats.poses_csv import read_poses
from twin.errors import DriveError

T0 = 1_781_078_400_123_456_789
HEADER = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg"


def table(*rows: str, header: str = HEADER) -> bytes:
    """Write a pose file."""
    return "\n".join([header, *rows, ""]).encode()


def test_poses_keep_every_nanosecond_and_digit() -> None:
    """Epochs of nineteen digits do not pass through a float; sigmas that no column states are NaN."""
    read = read_poses(
        table(f"{T0},63.41,10.39,80.5,0.5,-1.25,359.9", f"{T0 + 1},63.42,10.4,81,0,0,1"), "p.csv"
    )
    track = read.track
    assert track.epoch_ns.tolist() == [T0, T0 + 1]
    assert track.latitude_deg.tolist() == [63.41, 63.42]
    assert track.longitude_deg.tolist() == [10.39, 10.4]
    assert track.height_m.tolist() == [80.5, 81.0]
    assert track.roll_deg.tolist() == [0.5, 0.0]
    assert track.pitch_deg.tolist() == [-1.25, 0.0]
    assert track.heading_deg.tolist() == [359.9, 1.0]
    assert np.isnan(track.sigma_horizontal_m).all()
    assert (read.skipped, read.warnings) == ((), ())


def test_poses_with_nose_up_pitch_are_turned() -> None:
    """Only pitch changes its sign: roll is right side down in both conventions."""
    content = table(f"{T0},63.41,10.39,80,0.5,-1.25,90")
    up, down = read_poses(content, "p.csv", pitch_nose_up=True).track, read_poses(content, "p.csv").track
    assert up.pitch_deg.tolist() == [1.25]
    assert down.pitch_deg.tolist() == [-1.25]
    assert up.roll_deg.tolist() == down.roll_deg.tolist() == [0.5]


def test_poses_take_sigmas_where_given_and_nan_in_empty_cells() -> None:
    """A column of sigmas may have holes, and columns may come in any order."""
    header = "sigma_heading_deg,heading_deg,pitch_deg,roll_deg,height_m,longitude_deg,latitude_deg,time_ns"
    read = read_poses(
        table(f"0.5,90,0,0,80,10.4,63.4,{T0}", f",91,0,0,80,10.4,63.4,{T0 + 9}", header=header), "p.csv"
    )
    assert np.array_equal(read.track.sigma_heading_deg, [0.5, np.nan], equal_nan=True)
    assert read.track.heading_deg.tolist() == [90.0, 91.0]


def test_poses_tell_of_a_column_they_do_not_read() -> None:
    """A misspelt sigma would otherwise quietly be the default."""
    content = table(f"{T0},63.4,10.4,80,0,0,90,5", header=HEADER + ",sigma_horisontal_m")
    assert "sigma_horisontal_m" in read_poses(content, "p.csv").warnings[0]


@pytest.mark.parametrize(
    ("row", "reason"),
    [
        (f"{T0 + 5},91,10.4,80,0,0,90", "position outside the globe"),
        (f"{T0 + 5},63.4,10.4,1e9,0,0,90", "height absurd"),
        (f"{T0 + 5},0,0,80,0,0,90", "position 0° N 0° E (null island)"),
        (f"{T0 + 5},nan,10.4,80,0,0,90", "not finite"),
        (f"{T0 + 5},63.4,10.4,80,0,inf,90", "not finite"),
        (f"{T0 + 5},63.4,10.4,80,0,120,90", "attitude outside its range"),
        (f"{T0 + 5},63.4,10.4,80,0,,90", "not a number"),
        (
            "1.781e18,63.4,10.4,80,0,0,90",
            "time_ns rounded to a power of ten, as spreadsheets do: take the file from before",
        ),
        (f"{T0 // 1000},63.4,10.4,80,0,0,90", "time_ns outside the years 2000–2099"),
        (f"{T0 + 5},63.4,10.4", "row too short"),
        (f"{T0},63.4,10.4,80,0,0,90", "epoch not after the pose before"),
    ],
)
def test_pose_that_cannot_be_used_is_counted(row: str, reason: str) -> None:
    """The poses around it stay, and the count names the reason."""
    read = read_poses(table(f"{T0},63.4,10.4,80,0,0,90", row, f"{T0 + 9},63.4,10.4,80,0,0,90"), "p.csv")
    assert read.track.epoch_ns.tolist() == [T0, T0 + 9]
    assert counts(read.skipped) == {reason: 1}


def test_poses_with_a_sigma_of_zero_are_left_out() -> None:
    """A perfect pose would outweigh everything else."""
    header = HEADER + ",sigma_vertical_m"
    content = table(f"{T0},63.4,10.4,80,0,0,90,0", f"{T0 + 1},63.4,10.4,80,0,0,90,1", header=header)
    assert counts(read_poses(content, "p.csv").skipped) == {"sigma not positive": 1}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "lacks the columns time_ns"),
        (b"time,lat,lon\n1,2,3\n", r"lacks the columns time_ns, .*'time,lat,lon'"),
        (table(), "no usable pose .there is none in it"),
        (table("x,1,2,3,4,5,6"), "1 × not a number"),
        (table(header=HEADER + ",roll_deg"), "roll_deg more than once"),
    ],
)
def test_pose_file_that_cannot_be_used_is_refused_by_name(content: bytes, message: str) -> None:
    """The error names the file and what it lacks."""
    with pytest.raises(DriveError, match=message) as caught:
        read_poses(content, "p.csv")
    assert "p.csv" in str(caught.value)


def test_poses_in_descending_time_are_named_as_that() -> None:
    """A file sorted the wrong way round is told to be sorted."""
    header = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg\n"
    rows = [f"{1_780_000_000_000_000_000 - i * 10**8},63.4,10.4,50,0,0,90\n" for i in range(20)]
    with pytest.raises(DriveError, match="not in order of time"):
        read_poses((header + "".join(rows)).encode(), "poses.csv")
