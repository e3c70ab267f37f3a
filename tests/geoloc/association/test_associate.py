"""Association: sightings without ids become the objects that were there."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from geoloc.arrays import IntArray
from geoloc.association.associate import Association, associate, check_ids, join_cameras
from geoloc.errors import CalibrationError
from geoloc.locate.observations import Observations
from geoloc.locate.records import Sightings
from geoloc.reasons import Reason
from geoloc.rig.rig import Rig
from geoloc.simulation.car import true_camera
from geoloc.simulation.motion import TrueMotion
from geoloc.simulation.observe import project
from geoloc.simulation.road import Road
from geoloc.simulation.simulate import PoleSpec, Scenario, SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.poses import Poses
from geoloc.trajectory.trajectory import Trajectory, trajectory_from_gnss

FACE_HEIGHT_M = 2.5
CAMERA = "C2_tricam60"


class Score(NamedTuple):
    """Of the pairs of sightings that were put together, and of those that belong together."""

    precision: float
    recall: float


@dataclass(frozen=True)
class Seen:
    """What `associate` takes, and the truth."""

    rig: Rig
    sightings: Sightings
    poses: Poses
    kind: NDArray[np.str_]
    label: NDArray[np.str_]
    epoch_ns: IntArray
    truth: IntArray
    slip: NDArray[np.bool_]
    trajectory: Trajectory

    def take(self, rows: NDArray[np.generic]) -> Seen:
        """Those rows alone."""
        return Seen(
            self.rig,
            Sightings(self.sightings.camera[rows], self.sightings.pixel_px[rows]),
            Poses(**{f.name: getattr(self.poses, f.name)[rows] for f in fields(Poses)}),
            self.kind[rows],
            self.label[rows],
            self.epoch_ns[rows],
            self.truth[rows],
            self.slip[rows],
            self.trajectory,
        )

    def of(self, kind: str) -> Seen:
        """Feet alone, or faces alone."""
        return self.take(np.flatnonzero(self.kind == kind))

    def unlabelled(self) -> Seen:
        """The same without sign codes."""
        return replace(self, label=np.full(self.label.shape, ""))

    def associate(self) -> Association:
        """Associate without ids."""
        return associate(self.observations, self.label, self.poses)

    @property
    def observations(self) -> Observations:
        """The sightings without their objects."""
        unknown = np.full(self.kind.size, -1)
        return Observations(self.rig, self.sightings, self.kind, unknown, self.epoch_ns, self.trajectory)

    def findings(self, ids: IntArray) -> list[tuple[str, tuple[str, ...]]]:
        """Kinds and ids of what `check_ids` finds, ids being named T0, T1, …."""
        names = np.array([f"T{number}" for number in ids])
        found = check_ids(self.observations, self.label, names, self.poses)
        return [(finding.kind, finding.ids) for finding in found]

    def score(self, found: IntArray) -> Score:
        """Compare with the truth, slips of the hand aside; a sighting left out belongs with nothing."""
        table = np.zeros((self.truth.max() + 1, found.max() + 1))
        counted = ~self.slip & (found >= 0)
        np.add.at(table, (self.truth[counted], found[counted]), 1)
        true, put, both = (
            float((n * (n - 1.0) / 2.0).sum())
            for n in (np.bincount(self.truth[~self.slip]).astype(float), table.sum(axis=0), table)
        )
        return Score(both / put, both / true)


def assert_told_apart(seen: Seen) -> None:
    """Associate, and demand 98 % of the pairs both ways."""
    found = seen.score(seen.associate().object)
    assert found.precision >= 0.98
    assert found.recall >= 0.98


@cache
def driven(world: Scenario, seed: int) -> Seen:
    """Drive a world, and see feet and faces of its poles, with poses from GNSS as a real drive has them."""
    drive = simulate_drive(world, seed)
    trajectory = trajectory_from_gnss(
        drive.gnss, {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
    )
    feet = drive.sightings
    epoch = np.array([drive.frame_host_ns[c][f] for c, f in zip(feet.camera, feet.frame, strict=True)])
    every = Seen(
        drive.rig,
        Sightings(np.tile(feet.camera, 2), np.concatenate([feet.pixel_px, _faces(drive)])),
        trajectory.poses_at(np.tile(epoch, 2)),
        np.repeat(["foot", "box"], epoch.size),
        np.tile(drive.objects.skiltnummer[feet.object_index], 2),
        np.tile(epoch, 2),
        np.tile(feet.object_index, 2),
        np.concatenate([feet.blunder, np.zeros(epoch.size, dtype=bool)]),
        trajectory,
    )
    return every.take(np.flatnonzero(np.isfinite(every.sightings.pixel_px[:, 0])))


def _faces(drive: SimulatedDrive) -> NDArray[np.float64]:
    """Where an annotator finds a face over each foot, through the true camera; NaN off the image."""
    world, feet = drive.scenario, drive.sightings
    motion = TrueMotion(Road(world.road, drive.seed), world.motion, world.noise, drive.seed)
    time_s = (drive.frame_epoch_ns[feet.frame] - world.start_utc_ns) * 1e-9
    pixel = np.full(feet.pixel_px.shape, np.nan)
    for name in world.cameras:
        mine = feet.camera == name
        face = drive.objects.enu_m[feet.object_index[mine]] + np.array([0.0, 0.0, FACE_HEIGHT_M])
        camera = true_camera(drive.rig.camera(name), drive.drawn)
        true_px, on_image = project(world.noise, camera, motion, face, time_s[mine])
        tremble = np.random.default_rng(drive.seed).normal(size=true_px.shape) * world.noise.annotation_px
        pixel[mine] = np.where(on_image[:, None], true_px + tremble, np.nan)
    return pixel


def with_poles(*poles: PoleSpec) -> Scenario:
    """Return the first 18 seconds of the urban road, with other poles."""
    world = scenario("urban")
    return replace(world, poles=poles, motion=replace(world.motion, duration_s=18.0))


def two_poles() -> Seen:
    """Feet of two poles of different codes, far apart."""
    poles = PoleSpec("A", "516", 60.0, -5.0), PoleSpec("B", "202", 120.0, -5.0)
    return driven(with_poles(*poles), 5).of("foot")


@pytest.mark.parametrize(
    ("name", "seed"), [("urban", 0), ("urban", 1), ("highway", 0), ("highway", 1), ("sample", 0)]
)
def test_feet_of_simulated_drives_are_told_apart(name: str, seed: int) -> None:
    """Feet of all cameras become the poles they belong to, with and without sign codes."""
    feet = driven(scenario(name, None, seed), seed).of("foot")
    assert_told_apart(feet)
    assert_told_apart(feet.unlabelled())


@pytest.mark.parametrize("name", ["urban", "highway"])
def test_faces_alone_are_told_apart(name: str) -> None:
    """Faces, whose depth one picture does not tell, become the signs they belong to, without sign codes."""
    assert_told_apart(driven(scenario(name, None, 1), 1).of("box").unlabelled())


def test_faces_join_the_foot_below_them() -> None:
    """A pole's foot and its face become one object."""
    assert_told_apart(driven(scenario("highway", None, 0), 0))


def test_slips_of_the_hand_are_left_out() -> None:
    """With 2 % of the clicks on wrong pixels, the right objects are found, and only slips are left out."""
    world = scenario("urban", None, 3)
    seen = driven(replace(world, noise=replace(world.noise, blunder_rate=0.02)), 3).of("foot")
    association = seen.associate()
    found = seen.score(association.object)
    assert found.precision >= 0.98
    assert found.recall >= 0.98
    assert len(association.objects) == len(world.poles)
    left_out = association.object < 0
    assert left_out.sum() >= 10
    assert seen.slip[left_out].all()
    assert set(association.reason[left_out]) == {Reason.SLIP}


@pytest.mark.parametrize("codes", [("516", "362.50"), ("516", "516")])
@pytest.mark.parametrize("across", [True, False])
def test_poles_80_cm_apart_stay_apart(codes: tuple[str, str], across: bool) -> None:
    """Two poles 0.8 m apart, beside or behind one another, remain two objects even with equal codes."""
    along_m, across_m = (0.0, 0.8) if across else (0.8, 0.0)
    world = with_poles(
        PoleSpec("A", codes[0], 60.0, -5.0),
        PoleSpec("B", codes[1], 60.0 + along_m, -5.0 - across_m),
        PoleSpec("C", codes[0], 110.0, -5.0),
    )
    assert_told_apart(driven(world, 4).of("foot"))


def test_second_passage_joins_the_first() -> None:
    """The signs of a road driven again ten minutes later, 0.2 m off in position, are the same ones."""
    once = driven(scenario("highway", None, 1), 1).of("foot")
    both = once.take(np.tile(np.arange(once.truth.size), 2))
    later = np.repeat([False, True], once.truth.size)
    moved = both.poses.latitude_deg + np.where(later, 0.2 / 111_000.0, 0.0)
    epoch = both.epoch_ns + np.where(later, 600_000_000_000, 0)
    assert_told_apart(replace(both, poses=replace(both.poses, latitude_deg=moved), epoch_ns=epoch))


def test_association_does_not_depend_on_the_order_of_sightings() -> None:
    """Shuffled sightings get the same numbers."""
    seen = driven(scenario("highway", None, 1), 1).of("foot")
    order = np.random.default_rng(1).permutation(seen.truth.size)
    np.testing.assert_array_equal(seen.take(order).associate().object, seen.associate().object[order])


def test_objects_carry_count_and_label() -> None:
    """Each object says how many sightings it has and what label, and numbers follow first sightings."""
    seen = two_poles()
    association = seen.associate()
    assert [entry.label for entry in association.objects] == ["516", "202"]
    counts = np.bincount(association.object[association.object >= 0])
    assert [entry.n_sightings for entry in association.objects] == counts.tolist()
    assert association.object[np.argmin(seen.epoch_ns)] == 0


def test_unlabelled_sightings_join_labelled_ones() -> None:
    """An annotator who names a sign only now and then gets no second object for that."""
    seen = two_poles()
    label = np.where(np.arange(seen.label.size) % 3 == 0, seen.label, "")
    association = replace(seen, label=label).associate()
    assert [entry.label for entry in association.objects] == ["516", "202"]


def test_sightings_that_cannot_be_used_say_why() -> None:
    """A sighting without a pose, and one outside its picture, belong to nothing and say why."""
    seen = driven(scenario("approach"), 0).of("foot")
    valid = seen.poses.valid.copy()
    valid[0] = False
    pixel = seen.sightings.pixel_px.copy()
    pixel[1] = -50.0
    association = replace(
        seen,
        poses=replace(seen.poses, valid=valid, reason=np.where(valid, "", Reason.IN_GAP)),
        sightings=replace(seen.sightings, pixel_px=pixel),
    ).associate()
    assert association.object[:2].tolist() == [-1, -1]
    assert association.reason[:2].tolist() == [Reason.IN_GAP, Reason.OUTSIDE_CAMERA]
    assert (association.object[2:] == 0).all()


def test_no_sightings_are_no_objects() -> None:
    """An empty drive gives an empty association."""
    seen = driven(scenario("approach"), 0).of("foot")
    association = seen.take(np.zeros(0, dtype=np.int64)).associate()
    assert association.object.size == 0
    assert association.objects == ()


def test_unknown_camera_is_refused() -> None:
    """A camera that the rig lacks is a calibration error, not a silent nothing."""
    seen = driven(scenario("approach"), 0).of("foot")
    named = replace(seen.sightings, camera=np.full(seen.truth.size, "C9"))
    with pytest.raises(CalibrationError, match="C9"):
        replace(seen, sightings=named).associate()


def test_right_ids_raise_no_alarm() -> None:
    """Ids that follow the truth are not contradicted."""
    for name in ("urban", "highway"):
        seen = driven(scenario(name, None, 1), 1).of("foot")
        assert seen.findings(seen.truth) == []


def test_id_that_jumps_to_another_sign_is_found() -> None:
    """Two tracks that swap signs midway are each reported to hold two signs, and to be no single one."""
    world = with_poles(
        PoleSpec("A", "516", 60.0, -5.0), PoleSpec("B", "516", 61.5, 5.0), PoleSpec("C", "516", 120.0, -5.0)
    )
    seen = driven(world, 6).of("foot")
    half = seen.epoch_ns > np.median(seen.epoch_ns[seen.truth == 0])
    swapped = np.where(half & (seen.truth < 2), 1 - seen.truth, seen.truth)
    assert seen.findings(swapped) == [("split", ("T0",)), ("split", ("T1",))]


def test_two_ids_of_one_sign_are_found() -> None:
    """A track that was lost and begun anew under another id is reported, and only that one."""
    seen = driven(scenario("highway", None, 1), 1).of("foot")
    late = seen.epoch_ns > np.median(seen.epoch_ns[seen.truth == 3])
    ids = np.where(late & (seen.truth == 3), 99, seen.truth)
    assert seen.findings(ids) == [("merge", ("T3", "T99"))]


def camera_by_camera(seen: Seen) -> NDArray[np.str_]:
    """Ids of tracks that each camera numbers by itself, in an order of its own."""
    rng = np.random.default_rng(7)
    number = {camera: rng.permutation(seen.truth.max() + 1) for camera in np.unique(seen.sightings.camera)}
    pairs = zip(seen.sightings.camera.tolist(), seen.truth.tolist(), strict=True)
    return np.array([f"{camera}:{number[camera][pole]}" for camera, pole in pairs])


def joined(seen: Seen, ids: NDArray[np.str_], is_track: NDArray[np.bool_] | None = None) -> NDArray[np.str_]:
    """Join the tracks of cameras; all ids are tracks' where nothing else is said."""
    tracks = np.ones(ids.size, dtype=bool) if is_track is None else is_track
    number = np.unique(ids, return_inverse=True)[1]
    return join_cameras(replace(seen.observations, object_index=number), seen.label, ids, tracks)


@pytest.mark.parametrize("kinds", ["feet", "faces", "faces in one camera"])
@pytest.mark.parametrize("name", ["urban", "highway"])
def test_tracks_of_cameras_become_the_poles_they_show(name: str, kinds: str) -> None:
    """Each camera has numbers of its own, and one may mark faces where the others mark feet."""
    both = driven(scenario(name, None, 1), 1)
    face = both.kind == "box"
    wanted = {"feet": ~face, "faces": face, "faces in one camera": face == (both.sightings.camera == CAMERA)}
    seen = both.take(np.flatnonzero(wanted[kinds]))
    names = joined(seen, camera_by_camera(seen))
    pairs = set(zip(names.tolist(), seen.truth.tolist(), strict=True))
    poles = np.unique(seen.truth).size
    assert len({name for name, _ in pairs}) == len(pairs) == poles
    assert np.unique(camera_by_camera(seen)).size > 2 * poles


def test_two_tracks_of_one_camera_are_never_one_object() -> None:
    """One pole's two tracks, begun anew or side by side in other pictures: which is it is not guessed."""
    seen = driven(scenario("urban", None, 1), 1).of("foot")
    for part in (seen.epoch_ns > np.median(seen.epoch_ns), np.arange(seen.epoch_ns.size) % 2 == 0):
        again = part & (seen.sightings.camera == CAMERA)
        ids = np.where(again, np.char.add(camera_by_camera(seen), "again"), camera_by_camera(seen))
        names = joined(seen, ids)
        mine = seen.sightings.camera == CAMERA
        pairs = set(zip(names[mine].tolist(), ids[mine].tolist(), strict=True))
        assert len({name for name, _ in pairs}) == len(pairs)
        assert np.unique(names).size < np.unique(ids).size


def test_tracks_join_objects_that_an_annotator_named() -> None:
    """The attribute's name stays and tracks of other cameras get it; two names given stay two objects."""
    seen = driven(scenario("urban", None, 1), 1).of("foot")
    mine = seen.sightings.camera == CAMERA
    given = np.array([f"Z{number}" for number in seen.truth])
    ids = np.where(mine, given, camera_by_camera(seen))
    seen_by_it = np.isin(seen.truth, seen.truth[mine])
    assert (joined(seen, ids, ~mine)[seen_by_it] == given[seen_by_it]).all()
    apart = np.where(mine, given, np.char.add("other ", given))
    assert (joined(seen, apart, np.zeros(apart.size, dtype=bool)) == apart).all()
