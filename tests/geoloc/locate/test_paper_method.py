"""The paper's method to the letter."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from pyproj import Geod
from single_frame_rig import (
    EXACT,
    LAT0,
    LON0,
    RIG,
    WIDE,
    camera,
    pixels_of,
    poses_of,
)

from geoloc.arrays import FloatArray, IntArray
from geoloc.cameras.ftheta import FThetaCamera
from geoloc.earth.geodesy import (
    inverse,
    inverse_haversine,
    rotation_from_rpy,
)
from geoloc.locate.paper_readings import Distance, PaperReadings
from geoloc.locate.records import Sightings
from geoloc.locate.single_frame import locate_paper
from geoloc.reasons import Reason
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera
from geoloc.simulation.car import ANTENNAS, CAMERAS
from geoloc.simulation.simulate import SimulatedDrive, scenario, simulate_drive
from geoloc.trajectory.poses import GnssFixes
from geoloc.trajectory.trajectory import trajectory_from_gnss

GEOD = Geod(ellps="GRS80")


def test_paper_without_a_field_of_view_says_so() -> None:
    """A camera whose image edge lies outside its model has no linear bearing: rows that hit are rejected."""
    narrow = FThetaCamera(1920, 1208, 951.0, 612.0, theta_from_r=(0.0, 1e-3, 0.0, -4.5e-10))
    assert np.isnan(narrow.horizontal_fov_rad)
    one = RigCamera("n", narrow, rotation_from_rpy(0.0, 2.0, 0.0) @ FLU_R_RDF, np.array([1.8, 0.0, 1.5]))
    pixel = np.array([[951.0, 800.0], [951.0, 300.0]])
    found = locate_paper(Rig({"n": one}, {}, "test rig"), Sightings(np.array(["n", "n"]), pixel), poses_of(2))
    assert found.rejected.tolist() == [Reason.WIDER_THAN_MODEL, Reason.ABOVE_HORIZON]
    assert np.isnan(found.systematic_m).all()


def test_paper_is_its_equations_worked_by_hand() -> None:
    """Equation 1 and the inverse haversine, worked here for one pixel of the side camera.

    The camera's yaw is -88° counter-clockwise: ψ_camera is +88° clockwise.
    """
    one = RIG.cameras["side"]
    pixel = np.array([1200.0, 700.0])
    ray, _ = WIDE.camera_ray_from_pixel(pixel)
    rig_ray = one.rig_R_camera @ ray
    ground = one.rig_t_camera_m - one.rig_t_camera_m[2] / rig_ray[2] * rig_ray
    distance = np.hypot(ground[0], ground[1])
    theta = np.degrees(WIDE.horizontal_fov_rad) / 1920 * (1200.5 - 960.0) + 88.0 + 123.0
    lat, lon = inverse_haversine(LAT0, LON0, theta, distance)
    found = locate_paper(RIG, Sightings(np.array(["side"]), pixel[None]), poses_of(1, heading_deg=123.0))
    # The optical axis of a camera with roll and pitch has the yaw of its file to rounding.
    np.testing.assert_allclose(
        [found.latitude_deg[0], found.longitude_deg[0]], [lat, lon], rtol=0, atol=1e-11
    )


def test_paper_overshoots_by_the_sphere_and_bends_by_the_linear_bearing() -> None:
    """Straight ahead of a level camera the paper errs by the sphere alone: 0.25 % to the north at 63.4°N."""
    centred = FThetaCamera(1921, 1208, 960.0, 604.0, theta_from_r=(0.0, 1e-3))
    rig = Rig({"c": camera("c", centred, (0.0, 0.0, 1.5), (0.0, 0.0, 0.0))}, {}, "test rig")
    pixel = pixels_of(np.array([[12.0, 0.0, 0.0]]), rig.cameras["c"])
    found = locate_paper(rig, Sightings(np.array(["c"]), pixel), poses_of(1))
    azimuth, distance = inverse(LAT0, LON0, found.latitude_deg[0], found.longitude_deg[0])
    assert min(azimuth, 360.0 - azimuth) < 1e-3
    assert distance == pytest.approx(12.0 * 1.0025, abs=0.003)


def test_paper_states_the_error_of_late_and_distant_fixes() -> None:
    """At 15 m/s the link's 78 ms are 1.17 m systematic and 5 Hz fixes 0.87 m random, along the heading."""
    sighting = Sightings(np.array(["wide"]), np.array([[950.0, 800.0]]))
    found = locate_paper(RIG, sighting, poses_of(1, heading_deg=90.0, speed_mps=15.0), EXACT)
    column = found.systematic_m[0, :, found.source.index("link delay")]
    np.testing.assert_allclose(column, [0.078 * 15.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.random_m2[0], np.diag([(0.2 * 15.0) ** 2 / 12.0, 0.0]), atol=1e-9)
    punctual = locate_paper(
        RIG, sighting, poses_of(1, speed_mps=15.0), EXACT, fix_interval_s=0.0, delay_ms=0.0
    )
    np.testing.assert_allclose(punctual.covariance_m2[0], 0.0, atol=1e-12)


def _by_hand(
    mounted: tuple[FThetaCamera, tuple[float, ...], tuple[float, ...]],
    pixel: tuple[float, float],
    fix: tuple[float, float, float],
    distance: str,
    fov_deg: float | None,
) -> tuple[float, float]:
    """The paper's three equations for one pixel, by `math` alone: longitude and latitude, degrees."""
    lens, rpy_deg, (x0, y0, z0) = mounted
    k = lens.theta_from_r
    assert k is not None

    def off_axis(r: float) -> float:
        return sum(c * r**power for power, c in enumerate(k))

    u, v = pixel[0] - lens.cx_px, pixel[1] - lens.cy_px
    r = math.hypot(u, v)
    ahead, right, down = math.cos(off_axis(r)), math.sin(off_axis(r)) * u / r, math.sin(off_axis(r)) * v / r
    roll, pitch, yaw = (math.radians(angle) for angle in rpy_deg)
    x, y, z = ahead, -right, -down
    y, z = y * math.cos(roll) - z * math.sin(roll), y * math.sin(roll) + z * math.cos(roll)
    x, z = x * math.cos(pitch) + z * math.sin(pitch), z * math.cos(pitch) - x * math.sin(pitch)
    x, y = x * math.cos(yaw) - y * math.sin(yaw), x * math.sin(yaw) + y * math.cos(yaw)
    reach = -z0 / z
    d = {
        "rear-axle": math.hypot(x0 + reach * x, y0 + reach * y),
        "camera": reach * math.hypot(x, y),
        "ray": reach * math.sqrt(x * x + y * y + z * z),
    }[distance]
    fov = off_axis(lens.cx_px + 0.5) + off_axis(lens.width_px - 0.5 - lens.cx_px)
    if fov_deg is not None:
        fov = math.radians(fov_deg)
    latitude, longitude, heading = (math.radians(angle) for angle in fix)
    theta = fov / lens.width_px * (pixel[0] + 0.5 - lens.width_px / 2) - yaw + heading
    delta = d / 6_371_000.0
    phi = math.asin(
        math.sin(latitude) * math.cos(delta) + math.cos(latitude) * math.sin(delta) * math.cos(theta)
    )
    lam = longitude + math.atan2(
        math.sin(theta) * math.sin(delta) * math.cos(latitude),
        math.cos(delta) - math.sin(latitude) * math.sin(phi),
    )
    return math.degrees(lam), math.degrees(phi)


def _heading_by_hand(fixes: list[GnssFixes], k: int, source: str) -> float:
    """θ_car of fix k of the first antenna: of the pair, of the receiver, or of the neighbouring fixes."""
    own = fixes[0]
    if source == "receiver":
        return float(own.heading_deg[k])
    if source == "course":
        ends = [(own.longitude_deg[i], own.latitude_deg[i]) for i in (k - 1, k + 1)]
        return float(GEOD.inv(*ends[0], *ends[1])[0])
    ends = [(one.longitude_deg[k], one.latitude_deg[k]) for one in fixes]
    (x0, y0, _), (x1, y1, _) = (ANTENNAS[one.antenna][0] for one in fixes)
    return float(GEOD.inv(*ends[0], *ends[1])[0] + math.degrees(math.atan2(y1 - y0, x1 - x0)))


def _received_deg(drive: SimulatedDrive, epoch_ns: IntArray) -> FloatArray:
    """The car's heading at some epochs, as a receiver of 0.5° has it."""
    turned = np.interp(epoch_ns, drive.poses.epoch_ns, np.unwrap(drive.poses.heading_deg, period=360.0))
    return np.asarray((turned + np.random.default_rng(5).normal(scale=0.5, size=turned.size)) % 360.0)


@pytest.mark.parametrize("source", ["pair", "receiver", "course"])
def test_paper_is_an_independent_implementation_under_every_reading(source: str) -> None:
    """A drive with bends, worked by `math` and pyproj's Geod: no sighting differs by 1 µm."""
    drive = simulate_drive(scenario("urban", 30.0, 77), 77)
    frames, pixels = drive.sightings, drive.sightings.pixel_px
    arms = {name: np.array(arm) for name, (arm, _) in ANTENNAS.items()}
    stamps = np.array(
        [
            drive.frame_host_ns[camera][frame]
            for camera, frame in zip(frames.camera, frames.frame, strict=True)
        ]
    )
    for order in (drive.gnss, drive.gnss[::-1]):
        fixes = list(order) if source == "pair" else [order[0]]
        if source == "receiver":
            fixes = [replace(order[0], heading_deg=_received_deg(drive, order[0].epoch_ns))]
        nearest = trajectory_from_gnss(fixes, arms).nearest_fix(stamps)
        own = ANTENNAS[order[0].antenna][0]
        for distance, fov_deg, arm in itertools.product(
            Distance, ({}, {"C2_tricam60": 60.0, "C3_tricam120": 120.0}), ((0.0, 0.0), own[:2])
        ):
            readings = PaperReadings(distance, fov_deg, arm)
            found = locate_paper(drive.rig, Sightings(frames.camera, pixels), nearest, readings=readings)
            rows = np.flatnonzero(found.rejected == "")[::23]
            assert rows.size > 40
            for i in rows:
                k = int(np.argmin(np.abs(fixes[0].host_ns - stamps[i])))
                camera, heading = str(frames.camera[i]), _heading_by_hand(fixes, k, source)
                behind = heading + 180.0 - math.degrees(math.atan2(arm[1], arm[0]))
                at = fixes[0].longitude_deg[k], fixes[0].latitude_deg[k]
                longitude, latitude, _ = GEOD.fwd(*at, behind, math.hypot(*arm))
                fix = latitude, longitude, heading
                by_hand = _by_hand(CAMERAS[camera], tuple(pixels[i]), fix, str(distance), fov_deg.get(camera))
                off_m = GEOD.inv(*by_hand, found.longitude_deg[i], found.latitude_deg[i])[2]
                assert off_m < 1e-6
