"""Visibility against a brute-force projection of every site into every image."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from geoloc.cameras.ftheta import FThetaCamera
from geoloc.earth.geodesy import enu_offset, geographic_from_enu, rotation_enu_from_rig, rotation_from_rpy
from geoloc.errors import CalibrationError
from geoloc.locate.visibility import on_the_car_itself, views
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera
from geoloc.trajectory.trajectory import Poses

LAT0, LON0 = 63.4149, 10.3991
MODEL = FThetaCamera(1920, 1208, 955.0, 600.0, theta_from_r=(0.0, 1e-3, 0.0, 1e-11))


def _camera(name: str, yaw_deg: float) -> RigCamera:
    mask = np.zeros((151, 240), dtype=bool)
    mask[130:, 60:180] = True
    rotation = rotation_from_rpy(0.5, 3.0, yaw_deg) @ FLU_R_RDF
    return RigCamera(name, MODEL, rotation, np.array([1.5, 0.1, 1.4]), ego_mask=mask)


RIG = Rig({"front": _camera("front", 0.0), "rear": _camera("rear", 180.0)}, {}, "test rig")


def drive(n: int, seed: int = 1) -> Poses:
    """Poses scattered over a place 60 m wide, one in ten invalid."""
    rng = np.random.default_rng(seed)
    lat, lon = geographic_from_enu(LAT0, LON0, *rng.uniform(-30.0, 30.0, (2, n)))
    valid = rng.uniform(size=n) > 0.1
    some = np.where(valid, 0.0, np.nan)
    return Poses(
        np.arange(n),
        lat + some,
        lon + some,
        60.0 + some,
        rng.normal(0.0, 1.5, n) + some,
        rng.normal(0.0, 2.0, n) + some,
        rng.uniform(0.0, 360.0, n) + some,
        np.full(n, 10.0),
        np.full(n, 0.1),
        np.full(n, 0.1),
        np.full(n, 0.1),
        np.full(n, 0.1),
        np.full(n, 0.1),
        valid,
        np.where(valid, "", "a gap"),
    )


def count_views(
    rig: Rig, poses: Poses, lat: FloatArray, lon: FloatArray, **options: Any
) -> NDArray[np.int64]:
    """Count in how many images, camera and pose, each site was in view."""
    count = np.zeros(lat.size, dtype=np.int64)
    for in_view in views(rig, poses, lat, lon, **options):
        count += np.bincount(in_view.site, minlength=count.size)
    return count


def brute_force(poses: Poses, lat: FloatArray, lon: FloatArray, margin_px: float) -> NDArray[np.int64]:
    """Project each site into each image, one at a time, with geodesics instead of metres a degree."""
    count = np.zeros(lat.size, dtype=np.int64)
    for i in np.flatnonzero(poses.valid):
        east, north = enu_offset(poses.latitude_deg[i], poses.longitude_deg[i], lat, lon)
        enu_R_rig = rotation_enu_from_rig(poses.heading_deg[i], poses.pitch_deg[i], poses.roll_deg[i])
        xy = np.linalg.solve(enu_R_rig[:2, :2], np.stack([east, north])).T
        point = np.concatenate([xy, np.zeros((lat.size, 1))], axis=1)
        for one in RIG.cameras.values():
            offset = point - one.rig_t_camera_m
            pixel, seen = one.model.pixel_from_camera_point(offset @ one.rig_R_camera)
            for j in np.flatnonzero(seen):
                u, v = pixel[j]
                inner = margin_px <= u + 0.5 <= 1920 - margin_px and margin_px <= v + 0.5 <= 1208 - margin_px
                body = v + 0.5 >= 130 * 8 and 60 * 8 <= u + 0.5 < 180 * 8
                count[j] += inner and not body and 4.0 <= np.hypot(*offset[j, :2]) <= 20.0
    return count


def test_counts_equal_a_brute_force_projection() -> None:
    """Over 300 poses and 60 sites every count is that of projecting each pair by itself."""
    rng = np.random.default_rng(2)
    poses = drive(300)
    lat, lon = geographic_from_enu(LAT0, LON0, *rng.uniform(-45.0, 45.0, (2, 60)))
    found = count_views(RIG, poses, lat, lon)
    np.testing.assert_array_equal(found, brute_force(poses, lat, lon, 30.0))
    assert found.max() > 5
    assert found.min() == 0


def test_chunks_do_not_change_counts() -> None:
    """More poses than fit in a chunk count as the sum of their parts."""
    poses = drive(5000, seed=3)
    lat, lon = geographic_from_enu(LAT0, LON0, np.array([0.0, 10.0, 500.0]), np.array([0.0, -10.0, 0.0]))
    parts = np.zeros(3, dtype=np.int64)
    for rows in np.array_split(np.arange(5000), 7):
        part = Poses(*(getattr(poses, name)[rows] for name in Poses.__slots__))
        parts += count_views(RIG, part, lat, lon)
    whole = count_views(RIG, poses, lat, lon)
    np.testing.assert_array_equal(whole, parts)
    assert whole[2] == 0


def test_views_say_which_camera_saw_what_where() -> None:
    """A site 10 m ahead is seen by the front camera, one 10 m behind by the rear one, at their ranges."""
    poses = drive(1, seed=4)
    poses = replace(poses, heading_deg=np.array([90.0]), pitch_deg=np.zeros(1), roll_deg=np.zeros(1))
    lat, lon = geographic_from_enu(
        poses.latitude_deg[0], poses.longitude_deg[0], np.array([11.5, -8.5]), np.array([0.1, 0.1])
    )
    found = list(views(RIG, poses, lat, lon))
    assert [(one.camera.tolist(), one.site.tolist()) for one in found] == [(["front"], [0]), (["rear"], [1])]
    for one in found:
        np.testing.assert_allclose(one.range_m, 10.0, atol=1e-3)
        assert abs(one.pixel_px[0, 0] - 955.0) < 15.0
    assert count_views(RIG, poses, lat, lon, cameras=["front"]).tolist() == [1, 0]


def test_height_of_a_site_decides_whether_it_shows() -> None:
    """A site whose known height is above the image is not in view; an unknown height is the road's."""
    poses = drive(1, seed=4)
    poses = replace(poses, heading_deg=np.zeros(1), pitch_deg=np.zeros(1), roll_deg=np.zeros(1))
    lat, lon = geographic_from_enu(
        poses.latitude_deg[0], poses.longitude_deg[0], np.zeros(3), np.full(3, 9.0)
    )
    found = count_views(RIG, poses, lat, lon, height_m=np.array([60.0, 72.0, np.nan]))
    assert found.tolist() == [1, 0, 1]


def test_sites_without_a_position_are_never_in_view() -> None:
    """NaN coordinates count nothing, and a drive without a valid pose sees nothing."""
    assert count_views(RIG, drive(50), np.array([np.nan]), np.array([LON0])).tolist() == [0]
    blind = replace(drive(5), valid=np.zeros(5, dtype=bool))
    assert count_views(RIG, blind, np.array([LAT0]), np.array([LON0])).tolist() == [0]


def test_unknown_camera_is_an_error() -> None:
    """Asking for a camera that the rig lacks names it."""
    with pytest.raises(CalibrationError, match="C9"):
        count_views(RIG, drive(3), np.array([LAT0]), np.array([LON0]), cameras=["C9"])


def test_ego_mask_is_read_at_its_own_resolution() -> None:
    """A mask of 240 x 151 covers 1920 x 1208 pixels by eights; outside the image nothing is masked."""
    one = RIG.cameras["front"]
    pixel = np.array([[479.4, 1050.0], [479.6, 1050.0], [1439.4, 1207.4], [1439.6, 1207.4], [900.0, 1039.4]])
    assert on_the_car_itself(one, pixel).tolist() == [False, True, True, False, False]
    assert not on_the_car_itself(one, np.array([[900.0, 1300.0], [np.nan, 1100.0]])).any()
    assert not on_the_car_itself(replace(one, ego_mask=None), pixel).any()
