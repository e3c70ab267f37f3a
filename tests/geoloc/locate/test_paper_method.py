"""The paper's method to the letter."""

from __future__ import annotations

import numpy as np
import pytest
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

from geoloc.cameras.ftheta import FThetaCamera
from geoloc.earth.geodesy import (
    inverse,
    inverse_haversine,
    rotation_from_rpy,
)
from geoloc.locate.records import Sightings
from geoloc.locate.single_frame import locate_paper
from geoloc.reasons import Reason
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera


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
