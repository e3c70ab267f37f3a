"""The simulator: independent of the estimator, deterministic, and of the stated geometry."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest
from numpy.typing import NDArray

import geoloc.simulation.simulate
from geoloc.arrays import FloatArray
from geoloc.errors import GeolocError
from geoloc.simulation.car import ANTENNAS, CAMERAS
from geoloc.simulation.flat_frame import LocalFrame
from geoloc.simulation.motion import TrueMotion
from geoloc.simulation.road import Road
from geoloc.simulation.simulate import (
    SCENARIOS,
    MotionSpec,
    NoiseSpec,
    PoleSpec,
    RoadSpec,
    Scenario,
    SimulatedDrive,
    scenario,
    simulate_drive,
    without_noise,
)

FLAT_ROAD = RoadSpec(
    length_m=120.0,
    heading_deg=60.0,
    grade_percent=0.0,
    hills=(),
    roughness_m3=0.0,
    crossfall_percent=0.0,
    kerb_share=0.0,
    verge_sigma_m=0.0,
)
STRAIGHT_DRIVE = MotionSpec(duration_s=6.0, speed=((0.0, 10.0),), wander_m=0.0)
FLAT_WORLD = Scenario(
    "flat",
    FLAT_ROAD,
    STRAIGHT_DRIVE,
    (PoleSpec("A", "362.50", 40.0, -5.0), PoleSpec("B", "516", 62.0, 4.5), PoleSpec("C", "202", 75.0, -7.0)),
    noise=NoiseSpec.none(),
)


def _pixel_by_hand(camera: str, forward_m: float, left_m: float, down_m: float = 0.0) -> tuple[float, float]:
    """Project a point of the rig frame with nothing but trigonometry and a bisection."""
    model, (roll, pitch, yaw), (x, y, z) = CAMERAS[camera]
    p = np.array([forward_m - x, left_m - y, -down_m - z])
    r, q, w = np.radians([roll, pitch, yaw])
    # Undo yaw about z, then pitch about y, then roll about x.
    p = np.array([np.cos(w) * p[0] + np.sin(w) * p[1], -np.sin(w) * p[0] + np.cos(w) * p[1], p[2]])
    p = np.array([np.cos(q) * p[0] - np.sin(q) * p[2], p[1], np.sin(q) * p[0] + np.cos(q) * p[2]])
    p = np.array([p[0], np.cos(r) * p[1] + np.sin(r) * p[2], -np.sin(r) * p[1] + np.cos(r) * p[2]])
    right, down, ahead = -p[1], -p[2], p[0]
    theta, low, high = np.arctan2(np.hypot(right, down), ahead), 0.0, 1300.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        reached = sum(k * middle**i for i, k in enumerate(model.theta_from_r or ()))
        low, high = (middle, high) if reached < theta else (low, middle)
    direction = np.arctan2(down, right)
    return model.cx_px + low * np.cos(direction), model.cy_px + low * np.sin(direction)


def _arrays(drive: SimulatedDrive) -> Sequence[NDArray[np.generic]]:
    s, o, p = drive.sightings, drive.objects, drive.poses
    arrays = [s.camera, s.frame, s.object_index, s.pixel_px, s.blunder, o.enu_m, p.heading_deg, p.height_m]
    arrays += [a for f in drive.gnss for a in (f.host_ns, f.latitude_deg, f.longitude_deg, f.height_m)]
    return arrays + list(drive.frame_host_ns.values())


def test_same_seed_gives_the_same_drive() -> None:
    """Two runs of one seed agree in every bit, another seed differs in the fixes and the pixels."""
    world = scenario("approach", 15.0)
    first, second, other = (simulate_drive(world, seed) for seed in (3, 3, 4))
    for a, b in zip(_arrays(first), _arrays(second), strict=True):
        assert a.tobytes() == b.tobytes()
    assert not np.array_equal(first.gnss[0].latitude_deg, other.gnss[0].latitude_deg)
    assert not np.array_equal(first.sightings.pixel_px[:5], other.sightings.pixel_px[:5])


def test_one_source_of_noise_leaves_the_others_alone() -> None:
    """Turning the annotator's noise off changes no fix, no stamp and no true pixel."""
    world = scenario("approach", 15.0)
    noisy = simulate_drive(world, 5)
    calm = simulate_drive(replace(world, noise=replace(world.noise, annotation_px=0.0, blunder_rate=0.0)), 5)
    assert np.array_equal(noisy.gnss[1].longitude_deg, calm.gnss[1].longitude_deg)
    assert np.array_equal(noisy.frame_host_ns["C2_tricam60"], calm.frame_host_ns["C2_tricam60"])
    assert np.array_equal(calm.sightings.pixel_px, calm.sightings.true_pixel_px)
    assert np.array_equal(noisy.sightings.true_pixel_px, calm.sightings.true_pixel_px)


@pytest.mark.parametrize("camera", list(CAMERAS))
def test_pixels_equal_a_projection_by_hand(camera: str) -> None:
    """On a flat straight road a foot falls on the pixel that trigonometry and a bisection give."""
    drive = simulate_drive(FLAT_WORLD, 1)
    s = drive.sightings
    rows = np.flatnonzero(s.camera == camera)
    assert rows.size > 40
    for row in rows:
        pole = FLAT_WORLD.poles[s.object_index[row]]
        driven_m = 10.0 * s.frame[row] / 30.0
        by_hand = _pixel_by_hand(camera, pole.station_m - driven_m, pole.offset_m + 1.65)
        # The centre line is integrated numerically: 1e-6 m at 5 m is 4e-4 px at most.
        assert s.pixel_px[row] == pytest.approx(by_hand, abs=5e-4)


def test_rolling_shutter_sees_each_row_at_its_own_time() -> None:
    """With 26 µs a row a foot is seen where it is when its own row is read, not when the middle row is."""
    world = replace(FLAT_WORLD, noise=replace(NoiseSpec.none(), row_delay_us=26.0))
    s = simulate_drive(world, 1).sightings
    for row in range(0, s.frame.size, 7):
        pole = world.poles[s.object_index[row]]
        late_s = (s.pixel_px[row, 1] - 603.5) * 26e-6
        forward = pole.station_m - 10.0 * (s.frame[row] / 30.0 + late_s)
        by_hand = _pixel_by_hand(str(s.camera[row]), forward, pole.offset_m + 1.65)
        assert s.pixel_px[row] == pytest.approx(by_hand, abs=2e-3)
    assert np.abs(s.pixel_px[:, 1] - 603.5).max() > 250.0


def test_true_poses_and_positions_explain_the_pixels() -> None:
    """Geodesics of PROJ from the true pose to the true position lead to the pixel on a curved, bumpy road."""
    drive = simulate_drive(without_noise(scenario("sample")), 2)
    s, o, p = drive.sightings, drive.objects, drive.poses
    rows = np.arange(0, s.frame.size, 11)
    frame, index = s.frame[rows], s.object_index[rows]
    azimuth, _, distance = pyproj.Geod(ellps="GRS80").inv(
        p.longitude_deg[frame], p.latitude_deg[frame], o.longitude_deg[index], o.latitude_deg[index]
    )
    to_foot = np.stack(
        [
            distance * np.sin(np.radians(azimuth)),
            distance * np.cos(np.radians(azimuth)),
            o.height_m[index] - p.height_m[frame] - np.square(distance) / (2.0 * 6.38e6),
        ],
        axis=-1,
    )
    h, q, r = (np.radians(a[frame]) for a in (90.0 - p.heading_deg, p.pitch_deg, p.roll_deg))
    forward = np.stack([np.cos(h) * np.cos(q), np.sin(h) * np.cos(q), -np.sin(q)], axis=-1)
    level_left = np.stack([-np.sin(h), np.cos(h), 0.0 * h], axis=-1)
    level_up = np.cross(forward, level_left)
    left = np.cos(r)[:, None] * level_left + np.sin(r)[:, None] * level_up
    up = np.cross(forward, left)
    for k, row in enumerate(rows):
        x, y, z = (float(axis[k] @ to_foot[k]) for axis in (forward, left, up))
        by_hand = _pixel_by_hand(str(s.camera[row]), x, y, -z)
        # The sphere's curvature term and a slope of 2 % leave 0.1 mm: 0.05 px at the nearest foot.
        assert s.pixel_px[row] == pytest.approx(by_hand, abs=0.05)


def test_boresight_errors_turn_the_camera_about_the_rigs_axes() -> None:
    """A foot is seen as if it, and not the camera, had been turned back about the camera's centre."""
    world = replace(FLAT_WORLD, noise=replace(NoiseSpec.none(), boresight_deg=2.0))
    drive = simulate_drive(world, 6)
    s = drive.sightings
    for row in range(0, s.frame.size, 9):
        camera, pole = str(s.camera[row]), world.poles[s.object_index[row]]
        eye = np.array(CAMERAS[camera][2])
        foot = np.array([pole.station_m - 10.0 * s.frame[row] / 30.0, pole.offset_m + 1.65, 0.0]) - eye
        angle = np.linalg.norm(drive.drawn.boresight_deg[camera])
        axis, turn = drive.drawn.boresight_deg[camera] / angle, np.radians(-angle)
        # Rodrigues' formula.
        turned = foot * np.cos(turn) + np.cross(axis, foot) * np.sin(turn)
        turned += axis * (axis @ foot) * (1.0 - np.cos(turn))
        x, y, z = turned + eye
        assert s.pixel_px[row] == pytest.approx(_pixel_by_hand(camera, x, y, -z), abs=1e-3)


def test_world_without_poles_has_no_sightings() -> None:
    """A drive past nothing has fixes and frames, and arrays of length 0 for the rest."""
    drive = simulate_drive(replace(FLAT_WORLD, poles=()), 1)
    assert drive.sightings.pixel_px.shape == (0, 2)
    assert drive.objects.enu_m.shape == (0, 3)
    assert drive.frame_epoch_ns.size == 180


def test_leaving_the_road_is_refused() -> None:
    """A drive or a pole beyond the road's end and an unknown camera are refused in one sentence."""
    fast = replace(STRAIGHT_DRIVE, speed=((0.0, 60.0),))
    with pytest.raises(GeolocError, match="make the road longer or the drive shorter"):
        simulate_drive(replace(FLAT_WORLD, motion=fast), 1)
    far = (PoleSpec("far", "202", 900.0, 0.0),)
    with pytest.raises(GeolocError, match=r"station 900\.0 m is not on the simulated road"):
        simulate_drive(replace(FLAT_WORLD, poles=far), 1)
    with pytest.raises(GeolocError, match="C9_roof"):
        simulate_drive(replace(FLAT_WORLD, cameras=("C9_roof",)), 1)


def test_antennas_stand_where_the_lever_arms_say() -> None:
    """Without noise each fix is the antenna: 10 m/s along the road, height and side by the lever arm."""
    drive = simulate_drive(FLAT_WORLD, 1)
    frame = LocalFrame(FLAT_ROAD.latitude_deg, FLAT_ROAD.longitude_deg, FLAT_ROAD.height_m)
    heading = np.radians(60.0)
    for fixes in drive.gnss:
        arm, _ = ANTENNAS[fixes.antenna]
        enu = frame.enu_from_geographic(fixes.latitude_deg, fixes.longitude_deg, fixes.height_m)
        seconds = (fixes.epoch_ns - FLAT_WORLD.start_utc_ns) / 1e9
        along = enu[:, 0] * np.sin(heading) + enu[:, 1] * np.cos(heading)
        across = -enu[:, 0] * np.cos(heading) + enu[:, 1] * np.sin(heading)
        assert along == pytest.approx(10.0 * seconds + arm[0], abs=1e-5)
        assert across == pytest.approx(np.full(seconds.size, -1.65 + arm[1]), abs=1e-5)
        assert enu[:, 2] == pytest.approx(np.full(seconds.size, arm[2]), abs=1e-6)
        assert np.array_equal(fixes.host_ns, fixes.epoch_ns)


def test_local_frame_agrees_with_geodesics() -> None:
    """400 m from the origin, the plane's distance and direction are those of PROJ's geodesic to 1 mm."""
    frame = LocalFrame(63.4085, 10.452, 96.0)
    azimuth = np.radians(np.arange(0.0, 360.0, 30.0))
    enu = np.stack([400.0 * np.sin(azimuth), 400.0 * np.cos(azimuth), 0.0 * azimuth], axis=-1)
    latitude, longitude, height = frame.geographic_from_enu(enu)
    origin = np.full(azimuth.size, 63.4085), np.full(azimuth.size, 10.452)
    found, _, distance = pyproj.Geod(ellps="GRS80").inv(origin[1], origin[0], longitude, latitude)
    # The plane is 96 m above the ellipsoid: 400 m there are 6 mm less below.
    assert distance == pytest.approx(np.full(12, 400.0 * (1.0 - 96.0 / 6.39e6)), abs=1e-3)
    assert np.degrees(np.mod(np.radians(found) - azimuth + 0.1, 2 * np.pi) - 0.1) == pytest.approx(
        np.zeros(12), abs=1e-4
    )
    assert frame.enu_from_geographic(latitude, longitude, height) == pytest.approx(enu, abs=1e-6)


def test_bends_and_brakes_tilt_the_body() -> None:
    """A left bend leans the body right, braking dips its nose, and the crown of the road tilts it right."""
    noise = replace(NoiseSpec.none(), roll_deg_per_mps2=0.35, dive_deg_per_mps2=0.25)
    bend = replace(FLAT_ROAD, curvature=((0.0, 1 / 100.0),), crossfall_percent=2.0, crossfall_spread=0.0)
    # The rear axle takes a way of its own, 1.65 m outside the centre line.
    steady = simulate_drive(replace(FLAT_WORLD, road=bend, noise=noise), 1).poses
    assert steady.roll_deg == pytest.approx(
        np.full(steady.roll_deg.size, np.degrees(np.arctan(0.02)) + 0.35 * 10.0**2 / 101.65), abs=1e-3
    )
    braking = replace(STRAIGHT_DRIVE, speed=((1.0, 10.0), (5.0, 4.0)))
    poses = simulate_drive(replace(FLAT_WORLD, motion=braking, noise=noise), 1).poses
    # The smooth step is steepest in its middle: 1.5 times the mean of 1.5 m/s².
    assert poses.pitch_deg.max() == pytest.approx(0.25 * 2.25, abs=1e-3)
    # The horizon turns with the curved earth by 0.0005 degrees on the way.
    assert poses.pitch_deg.min() == pytest.approx(0.0, abs=1e-3)


def test_crossfall_differs_from_road_to_road() -> None:
    """Over 300 roads the right lane falls to the right by 3 %, with the stated spread."""
    spec = replace(FLAT_ROAD, crossfall_percent=3.0, crossfall_spread=0.3)
    at, lane = np.array([10.0]), np.array([-1.65])
    fall = np.array([Road(spec, seed).across_slope(at, lane)[0] for seed in range(300)])
    assert fall.mean() == pytest.approx(0.03, abs=0.002)
    assert fall.std() == pytest.approx(0.009, rel=0.12)


def test_road_falls_inwards_in_its_sharpest_bend() -> None:
    """Both lanes of a left bend fall to the left by the superelevation, and the surface has that slope."""
    curvature = ((0.0, 0.0), (60.0, 1 / 200.0), (120.0, 0.0))
    spec = replace(FLAT_ROAD, curvature=curvature, crossfall_percent=3.0, superelevation_percent=7.0)
    road, station, offset = Road(spec, 1), np.full(2, 60.0), np.array([-1.5, 1.5])
    assert road.across_slope(station, offset) == pytest.approx([-0.07, -0.07], abs=1e-9)
    assert road.surface_m(station, offset) == pytest.approx([0.105, -0.105], abs=1e-9)
    assert np.diff(road.across_slope(np.zeros(2), offset))[0] < -0.03


def test_climbing_lifts_the_nose() -> None:
    """On a grade of 5 % the pitch is minus atan(0.05), to the 0.0005 degrees of the curved earth."""
    world = replace(FLAT_WORLD, road=replace(FLAT_ROAD, grade_percent=5.0))
    poses = simulate_drive(world, 1).poses
    assert poses.pitch_deg == pytest.approx(
        np.full(poses.pitch_deg.size, -np.degrees(np.arctan(0.05))), abs=1e-3
    )


def test_speed_profile_is_the_derivative_of_the_distance() -> None:
    """Distance integrates the speed through smooth steps: the trapezoidal rule agrees to 0.1 mm."""
    spec = MotionSpec(duration_s=20.0, speed=((2.0, 11.0), (6.0, 5.0), (9.0, 5.0), (14.0, 13.0)))
    motion = TrueMotion(Road(replace(FLAT_ROAD, length_m=400.0), 1), spec, NoiseSpec.none(), 1)
    time = np.linspace(0.0, 20.0, 20_001)
    speed, acceleration, distance = motion.speed_mps(time)
    trapezoids = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * 1e-3)])
    assert distance == pytest.approx(trapezoids, abs=1e-4)
    assert np.gradient(speed, time) == pytest.approx(acceleration, abs=5e-3)


def test_body_jitter_grows_with_speed() -> None:
    """At 50 km/h pitch jitters by its stated sigma plus idling, standing still by idling alone."""
    noise = replace(NoiseSpec.none(), pitch_jitter_deg=0.10, idle_jitter_deg=0.01)
    for speed, expected in ((50.0 / 3.6, 0.11), (0.0, 0.01)):
        motion = MotionSpec(duration_s=200.0, speed=((0.0, speed),), wander_m=0.0)
        road = Road(replace(FLAT_ROAD, length_m=3000.0), 1)
        body = TrueMotion(road, motion, noise, 3).at(np.arange(0.0, 200.0, 0.05))
        pitch_deg = -np.degrees(np.arcsin(body.enu_R_rig[:, 2, 0]))
        # 200 s hold about 260 independent swings.
        assert pitch_deg.std() == pytest.approx(expected, rel=0.15)


def test_road_ahead_lies_off_the_cars_plane_as_stated() -> None:
    """Ground 15 m ahead lies 0.3 ± 0.1 degrees off the car's plane, rms, in the default road."""
    road = Road(RoadSpec(length_m=2000.0), 4)
    station = np.arange(0.0, 1900.0, 0.5)
    offset = np.full(station.size, -1.65)

    def rise(distance: float) -> FloatArray:
        return (road.surface_m(station + distance, offset) - road.surface_m(station, offset)) / distance

    relative = np.degrees(rise(15.0) - rise(2.85))
    assert 0.2 < relative.std() < 0.4


@pytest.mark.parametrize(
    ("name", "poles"), [("sample", 15), ("still", 3), ("approach", 1), ("urban", 13), ("highway", 16)]
)
def test_scenario_shows_every_pole_to_every_annotated_camera(name: str, poles: int) -> None:
    """Each scenario has its number of poles, and each annotated camera sees each pole at least ten times."""
    world = scenario(name, seed=2)
    drive = simulate_drive(world, 2)
    assert drive.objects.object.size == poles
    for camera in world.cameras:
        seen = drive.sightings.object_index[drive.sightings.camera == camera]
        assert np.bincount(seen, minlength=poles).min() >= 10, camera
    low, high = world.range_m
    assert drive.sightings.range_m.min() >= low
    assert drive.sightings.range_m.max() <= high


def test_still_objects_stand_at_the_papers_distances() -> None:
    """Where the car stands, three objects are 9.0, 11.8 and 19.3 m from the rig's origin, in plan."""
    drive = simulate_drive(without_noise(scenario("still")), 1)
    o, p = drive.objects, drive.poses
    stop = np.full(3, p.longitude_deg[-1]), np.full(3, p.latitude_deg[-1])
    distance = pyproj.Geod(ellps="GRS80").inv(*stop, o.longitude_deg, o.latitude_deg)[2]
    assert distance == pytest.approx([9.0, 11.8, 19.3], abs=1e-3)


def test_still_car_drives_up_and_is_annotated_only_where_it_stands() -> None:
    """The car drives 57 m at up to 20 km/h; all annotated frames, over 4 s, are taken from one place."""
    world = scenario("still")
    drive = simulate_drive(world, 1)
    motion = TrueMotion(Road(world.road, 1), world.motion, world.noise, 1)
    speed, _, way = motion.speed_mps(np.arange(drive.frame_epoch_ns.size) / 30.0)
    annotated = np.unique(drive.sightings.frame)
    assert speed.max() == pytest.approx(20.0 / 3.6)
    assert way[-1] == pytest.approx(56.67, abs=0.01)
    assert np.ptp(annotated) / 30.0 == pytest.approx(4.0, abs=0.2)
    assert np.abs(speed[annotated]).max() == 0.0
    assert np.ptp(way[annotated]) < 1e-9


def test_scenarios_refuse_nonsense() -> None:
    """An unknown name and an absurd speed each get one sentence that says what would do."""
    with pytest.raises(GeolocError, match="choose one of sample, still, approach, urban, highway"):
        scenario("motorway")
    with pytest.raises(GeolocError, match="1 to 130 km/h, not 900"):
        scenario("urban", 900.0)
    assert set(SCENARIOS) == {"sample", "still", "approach", "urban", "highway"}


def test_simulator_borrows_nothing_from_the_estimator() -> None:
    """The simulator imports no estimator: nor any formula of its trajectories."""
    root = Path(geoloc.simulation.simulate.__file__).parent
    imported: dict[str, set[str]] = {}
    for path in sorted(root.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("geoloc"):
                imported.setdefault(node.module, set()).update(alias.name for alias in node.names)
    own = {name for name in imported if name.startswith("geoloc.simulation")}
    assert set(imported) - own == {
        "geoloc.calibration.extrinsics.observations",
        "geoloc.cameras.base",
        "geoloc.cameras.ftheta",
        "geoloc.errors",
        "geoloc.earth.geodesy",
        "geoloc.arrays",
        "geoloc.rig.rig",
        "geoloc.trajectory.trajectory",
        "geoloc.trajectory.poses",
        "geoloc.trajectory.vehicle_motion",
        "geoloc.calibration.extrinsics.tag_family",
    }
    # Records alone, and none of the formulas beside them.
    assert imported["geoloc.calibration.extrinsics.observations"] == {"Pose", "Tag", "TagPicture"}
    assert imported["geoloc.cameras.base"] == {"CameraModel"}
    assert imported["geoloc.trajectory.trajectory"] == {"GnssFixes", "PoseTrack"}
    assert imported["geoloc.trajectory.poses"] == {"GnssFixes"}
    assert imported["geoloc.trajectory.vehicle_motion"] == {"MotionSeries", "VehicleMotion"}
    # What is painted on the tags; tests of the detector paint the official code themselves.
    assert imported["geoloc.calibration.extrinsics.tag_family"] == {"FAMILY", "dictionary_of"}
    assert imported["geoloc.earth.geodesy"] == {"utm33_from_geographic", "rotation_from_rpy"}


def test_one_road_is_driven_both_ways_on_different_days() -> None:
    """With a seed of its own the road and its poles stay; the car heads the other way, in the other lane."""
    there = replace(FLAT_WORLD, road=replace(scenario("highway").road, length_m=120.0, seed=7))
    motion = replace(STRAIGHT_DRIVE, against=True, start_station_m=110.0, lane_offset_m=1.65)
    back = replace(there, motion=motion)
    first, second = simulate_drive(there, 1), simulate_drive(back, 2)
    np.testing.assert_array_equal(first.objects.enu_m, second.objects.enu_m)
    turned = np.interp(0.5, [0, 1], second.poses.heading_deg[:2]) - np.interp(
        0.5, [0, 1], first.poses.heading_deg[:2]
    )
    assert turned % 360.0 == pytest.approx(180.0, abs=20.0)
    motions = [
        TrueMotion(Road(world.road, seed), world.motion, world.noise, seed)
        for seed, world in ((1, there), (2, back))
    ]
    met = [one.at(np.array([5.0])) for one in motions]
    # After 5 s they are 10 m from meeting, and drive on the right: each has the other to its left.
    to_other = met[1].position_m[0] - met[0].position_m[0]
    assert met[0].enu_R_rig[0][:, 1] @ to_other == pytest.approx(3.3, abs=0.3)
    assert met[1].enu_R_rig[0][:, 1] @ -to_other == pytest.approx(3.3, abs=0.3)
