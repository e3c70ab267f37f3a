"""Association on a track of ordinary fixes: it is corrected by the objects that were found."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from geoloc.adjustment.adjust import adjust
from geoloc.arrays import IntArray
from geoloc.association.associate import associate, associate_drive, check_ids, poses_by_objects
from geoloc.earth.geodesy import wrap_deg
from geoloc.locate.observations import Observations
from geoloc.locate.records import Sightings
from geoloc.simulation.simulate import PoleSpec, SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.poses import GnssFixes, Poses
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_gnss

POLES = (
    PoleSpec("A", "516", 45.0, -5.0),
    PoleSpec("B", "516", 46.5, -5.0),
    PoleSpec("C", "366", 62.0, 5.0),
    PoleSpec("D", "202", 80.0, -5.0),
    PoleSpec("E", "202", 80.0, -6.5),
    PoleSpec("F", "372", 96.0, -5.0),
)


@dataclass(frozen=True)
class Seen:
    """A simulated drive, its trajectory, and what `associate_drive` takes of its sightings."""

    drive: SimulatedDrive
    trajectory: Trajectory
    sightings: Sightings
    kind: NDArray[np.str_]
    code: NDArray[np.str_]
    epoch_ns: IntArray

    @property
    def truth(self) -> IntArray:
        """Pole of each sighting."""
        return self.drive.sightings.object_index

    def observations(self, object_index: IntArray) -> Observations:
        """The sightings as of those objects."""
        return Observations(
            self.drive.rig, self.sightings, self.kind, object_index, self.epoch_ns, self.trajectory
        )

    def objects(self, found: IntArray) -> list[set[int]]:
        """Poles of which an object has 5 % of its sightings or more, slips of the hand aside; by object."""
        firm = ~self.drive.sightings.blunder & (found >= 0)
        counts = [np.bincount(self.truth[firm & (found == k)]) for k in range(int(found.max()) + 1)]
        return [set(np.flatnonzero(count > 0.05 * count.sum()).tolist()) for count in counts]


@cache
def seen_with(fixes: str) -> Seen:
    """15 seconds of a street in a bend, with RTK, or with one antenna's fixes at 1 Hz that are off by 2 m."""
    world = scenario("urban")
    world = replace(world, poles=POLES, motion=replace(world.motion, duration_s=15.0))
    if fixes != "RTK":
        noise = replace(
            world.noise,
            gnss_white_horizontal_m=0.3,
            gnss_white_vertical_m=0.5,
            gnss_slow_horizontal_m=1.9,
            gnss_slow_vertical_m=3.0,
            gnss_multipath_m=0.5,
        )
        world = replace(world, noise=noise)
    drive = simulate_drive(world, 3)
    arms = {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
    gnss = drive.gnss if fixes == "RTK" else (_each_second(drive.gnss[0]),)
    sightings = drive.sightings
    pictures = zip(sightings.camera.tolist(), sightings.frame, strict=True)
    return Seen(
        drive,
        trajectory_from_gnss(gnss, arms),
        Sightings(sightings.camera, sightings.pixel_px),
        np.full(sightings.camera.size, "foot"),
        drive.objects.skiltnummer[sightings.object_index],
        np.array([drive.frame_host_ns[camera][frame] for camera, frame in pictures]),
    )


def _each_second(fixes: GnssFixes) -> GnssFixes:
    rows = np.arange(0, fixes.epoch_ns.size, 5)
    columns = {f.name: getattr(fixes, f.name)[rows] for f in fields(fixes) if f.name != "antenna"}
    return replace(fixes, **{**columns, "quality": np.ones(rows.size, dtype=np.int64)})


def test_poles_on_a_track_of_2_m_fixes_are_each_found_once() -> None:
    """The track as it is gives some poles twice; corrected by them, each once, also those 1.5 m apart."""
    seen = seen_with("2 m")
    what = seen.observations(np.full(seen.truth.size, -1)), seen.code
    alone, found = associate(*what), associate_drive(*what)
    assert len(alone.objects) > len(POLES)
    assert sorted(map(sorted, seen.objects(found.object))) == [[k] for k in range(len(POLES))]


@pytest.mark.parametrize("fixes", ["RTK", pytest.param("2 m", marks=pytest.mark.slow)])
def test_codes_are_not_needed_on_either_track(fixes: str) -> None:
    """Without sign codes, too, each pole is one object."""
    seen = seen_with(fixes)
    nameless = np.full(seen.code.shape, "")
    found = associate_drive(seen.observations(np.full(seen.truth.size, -1)), nameless)
    assert sorted(map(sorted, seen.objects(found.object))) == [[k] for k in range(len(POLES))]


def test_good_track_is_taken_as_it_is() -> None:
    """RTK poses are better than what association takes for granted: no adjustment is asked."""
    seen = seen_with("RTK")
    poses = poses_by_objects(seen.observations(seen.truth))
    plain = seen.trajectory.poses_at(seen.epoch_ns)
    for field in fields(Poses):
        np.testing.assert_array_equal(getattr(poses, field.name), getattr(plain, field.name))


def test_adjusted_poses_turn_as_the_car_did() -> None:
    """Of what a heading errs from one moment to another, less than a third is left after the adjustment."""
    seen = seen_with("2 m")
    adjusted = adjust(seen.observations(seen.truth)).poses
    plain = seen.trajectory.poses_at(seen.epoch_ns)
    true_deg = seen.drive.poses.heading_deg[seen.drive.sightings.frame]
    before, after = (np.std(wrap_deg(poses.heading_deg - true_deg)) for poses in (plain, adjusted))
    assert after < before / 3.0


def test_sightings_that_took_no_part_are_corrected_as_their_neighbours() -> None:
    """A sighting that belongs to no object stands on the corrected track too."""
    seen = seen_with("2 m")
    ids = seen.truth.copy()
    ids[::7] = -1
    poses = adjust(seen.observations(ids)).poses
    plain = seen.trajectory.poses_at(seen.epoch_ns)
    true_deg = seen.drive.poses.heading_deg[seen.drive.sightings.frame]
    before, after = (np.std(wrap_deg(one.heading_deg - true_deg)[::7]) for one in (plain, poses))
    assert after < before / 3.0


def test_right_ids_on_a_track_of_2_m_fixes_raise_no_alarm() -> None:
    """Ids are checked on the corrected track: the plain one contradicts right ids."""
    seen = seen_with("2 m")
    what = seen.observations(seen.truth), seen.code, seen.drive.objects.object[seen.truth]
    assert check_ids(*what, seen.trajectory.poses_at(seen.epoch_ns))
    assert check_ids(*what) == ()


def test_drive_without_sightings_has_no_objects() -> None:
    """Nothing seen on a poor track is nothing found."""
    seen = seen_with("2 m")
    none = seen.observations(seen.truth).take(np.zeros(0, dtype=np.int64))
    found = associate_drive(none, np.zeros(0, dtype="U4"))
    assert found.object.size == 0
