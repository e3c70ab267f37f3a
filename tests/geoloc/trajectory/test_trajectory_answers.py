"""The fix nearest to a stamp, as the paper pairs them, and the drive's line."""

from __future__ import annotations

import numpy as np
import pytest
from circle_drive import PAIR, Circle, epochs, record, turned

from geoloc.earth.geodesy import enu_offset
from geoloc.reasons import Reason
from geoloc.trajectory.trajectory import course_over_ground, trajectory_from_gnss


def test_nearest_fix_with_late_host_stamps_is_off_by_speed_times_delay() -> None:
    """The paper's pairing puts a frame at a fix measured 78 ms earlier: 78 ms times 12 m/s behind the truth.

    At the very stamp of a fix, so that the nearest one is exact and only the delay remains.
    """
    drive = Circle(radius_m=1e6)
    one = record(drive, np.zeros(3), delay_ms=78.0)
    trajectory = trajectory_from_gnss([one], {"left": np.zeros(3)})
    frames = one.host_ns[20:200]
    nearest = trajectory.nearest_fix(frames)
    truth = trajectory.poses_at(frames)
    east, north = enu_offset(
        truth.latitude_deg, truth.longitude_deg, nearest.latitude_deg, nearest.longitude_deg
    )
    np.testing.assert_allclose(np.hypot(east, north), 0.078 * 12.0, atol=1e-3)
    assert turned(course_over_ground(np.stack([-east, -north], axis=1)), truth.heading_deg).max() < 0.1
    np.testing.assert_array_equal(nearest.epoch_ns, frames)
    assert trajectory.delay_ms() == pytest.approx((78.0, 78.0))
    assert trajectory.interval_s == pytest.approx(0.1)


def test_nearest_fix_is_the_antenna_itself_with_the_heading_of_the_pair() -> None:
    """No lever arm is taken off, and the heading is that of the two antennas at that fix."""
    drive = Circle()
    fixes = [record(drive, lever, name) for name, lever in PAIR.items()]
    trajectory = trajectory_from_gnss(fixes, PAIR)
    asked = fixes[0].host_ns[30:60] + 30_000_000
    nearest = trajectory.nearest_fix(asked)
    np.testing.assert_array_equal(nearest.latitude_deg, fixes[0].latitude_deg[30:60])
    np.testing.assert_array_equal(nearest.height_m, fixes[0].height_m[30:60])
    assert (
        turned(nearest.heading_deg, drive.heading_deg(np.arange(30, 60) * 0.1)).max() < 5e-3
    )  # meridians converge by 0.001° in 60 m
    far = trajectory.nearest_fix(np.array([fixes[0].host_ns[-1] + 5_000_000_000]))
    assert not far.valid[0]
    assert far.reason[0] == Reason.FIX_FAR_OFF


def test_nearest_fix_of_one_antenna_has_the_course_between_its_neighbours() -> None:
    """With one antenna the heading is the chord from the fix before to the fix after."""
    drive = Circle()
    trajectory = trajectory_from_gnss([record(drive, np.zeros(3))], {"left": np.zeros(3)})
    heading = trajectory.nearest_fix(epochs(np.arange(10, 50) * 0.1)).heading_deg
    assert turned(heading, drive.heading_deg(np.arange(10, 50) * 0.1)).max() < 1e-3


def test_line_is_thinned_to_metres() -> None:
    """The drive's line has a point about every metre, from the first pose to the last."""
    drive = Circle(speed_mps=3.0)
    trajectory = trajectory_from_gnss([record(drive, np.zeros(3))], {"left": np.zeros(3)})
    lat, lon = trajectory.line()
    east, north = enu_offset(lat[:-1], lon[:-1], lat[1:], lon[1:])
    step = np.hypot(east, north)
    assert step[:-1].min() > 0.5
    assert step.max() < 1.5
    assert step.sum() == pytest.approx(3.0 * 29.9, rel=0.01)
