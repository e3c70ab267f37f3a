"""Pictures and measured places that contradict each other as a whole: refused or told, with the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from yard_scene import LEFT, MODELS, RIG, RIGHT, WIDE, off, pictures_of

from geoloc.calibration.extrinsics import Tag, calibrate_extrinsics
from geoloc.calibration.extrinsics.doubts import doubts
from geoloc.cameras import CameraModel, FThetaCamera
from geoloc.errors import CalibrationError
from geoloc.simulation.pictures.yard import Yard, draw_yard, seen_tags


def with_angles(camera: str, factor: float) -> CameraModel:
    """The camera with all angles larger by a factor: a focal length that is shorter by it."""
    model = MODELS[camera]
    assert isinstance(model, FThetaCamera)
    assert model.theta_from_r is not None
    return replace(model, theta_from_r=tuple(factor * c for c in model.theta_from_r), r_from_theta=None)


def some_of(yard: Yard, step: int) -> dict[int, Tag]:
    """Every so many of the standing tags, and of those on the floor."""
    standing = [number for number, tag in yard.tags.items() if not tag.on_floor]
    floor = [number for number, tag in yard.tags.items() if tag.on_floor]
    return {number: yard.tags[number] for number in (*standing[3::step], *floor[::2])}


@pytest.mark.parametrize("percent", [0.5, 1.0])
def test_wrong_focal_length_is_refused_with_its_error(percent: float) -> None:
    """Intrinsics with another focal length are refused, the camera named with its error to 0.2 %."""
    yard = draw_yard(np.random.default_rng(30))
    wide = seen_tags(yard, RIG.cameras[WIDE], np.random.default_rng(1), sigma_px=0.02)
    models = {WIDE: with_angles(WIDE, 1.0 + percent / 100.0)}
    with pytest.raises(CalibrationError, match="fits with other focal lengths") as refused:
        calibrate_extrinsics(models, [wide], some_of(yard, 3))
    told = str(refused.value).split(f"{WIDE}'s ")[1].split(")")[0]
    assert told.endswith(" % longer")
    assert float(told.split(" %")[0]) == pytest.approx(percent, abs=0.2)


@pytest.mark.slow
def test_contradictory_places_are_refused_without_a_false_reason() -> None:
    """Half of the places moved at random fit no other focal length: refused with what to check."""
    yard, rng = draw_yard(np.random.default_rng(31)), np.random.default_rng(2)
    tags = some_of(yard, 2)
    for number in [number for number, tag in tags.items() if not tag.on_floor][::2]:
        moved = tags[number].centre_m + rng.normal(scale=0.04, size=3)
        tags[number] = replace(tags[number], centre_m=moved)
    wide = seen_tags(yard, RIG.cameras[WIDE], rng, sigma_px=0.02)
    with pytest.raises(CalibrationError, match="check that places are x forward"):
        calibrate_extrinsics(MODELS, [wide], tags)


@pytest.mark.slow
def test_exchanged_pictures_are_refused_by_their_cameras() -> None:
    """Pictures of two cameras under each other's names are told as exchanged."""
    yard = draw_yard(np.random.default_rng(32))
    named = {LEFT: RIGHT, RIGHT: LEFT}
    pictures = [replace(p, camera=named.get(p.camera, p.camera)) for p in pictures_of(yard, sigma_px=0.02)]
    with pytest.raises(CalibrationError, match=f"The pictures of {LEFT} and {RIGHT} seem to be exchanged"):
        calibrate_extrinsics(MODELS, pictures, yard.tags)


def test_camera_that_fits_badly_is_told_before_tags() -> None:
    """Corners that scatter by 0.3 px make a camera doubtful, first of all; it weighs less."""
    yard = draw_yard(np.random.default_rng(33))
    left, *others = pictures_of(yard, sigma_px=0.02)
    noise = np.random.default_rng(3).normal(scale=0.3, size=left.corners_px.shape)
    left = replace(left, corners_px=left.corners_px + noise)
    found = calibrate_extrinsics(MODELS, [left, *others], yard.tags)
    assert doubts(found)[0].startswith(f"{LEFT}: its corners are uncertain by 0.")
    assert not any(text.startswith((RIGHT, WIDE)) for text in doubts(found))
    assert np.abs(off(found, WIDE)[:3]).max() < 0.03


def test_only_camera_that_fits_badly_is_told() -> None:
    """A camera without others to compare it with is doubtful from a quarter of a pixel on."""
    yard = draw_yard(np.random.default_rng(34))
    wide = seen_tags(yard, RIG.cameras[WIDE], np.random.default_rng(4), sigma_px=0.4)
    (told,) = doubts(calibrate_extrinsics(MODELS, [wide], yard.tags))
    assert told.startswith(f"{WIDE}: its corners are uncertain by 0.")


def test_swapped_ids_are_told_as_a_pair() -> None:
    """Two tags whose places were exchanged are told as swapped, and nothing else is blamed."""
    yard = draw_yard(np.random.default_rng(35))
    one, other = yard.tags[9], yard.tags[10]
    exchanged = {
        9: replace(one, centre_m=other.centre_m),
        10: replace(other, centre_m=one.centre_m),
    }
    found = calibrate_extrinsics(MODELS, pictures_of(yard, sigma_px=0.02), {**yard.tags, **exchanged})
    assert found.swapped == ((9, 10),)
    assert found.used.all()
    (told,) = doubts(found)
    assert told.startswith("Tag 9 and tag 10 are swapped")


def test_leaning_heights_are_refused_as_heights() -> None:
    """Heights measured along a slope of one degree are told as that, and not as intrinsics."""
    yard = draw_yard(np.random.default_rng(36))
    slope = np.tan(np.radians(1.0))
    tags = {
        i: replace(t, centre_m=t.centre_m - [0.0, 0.0, slope * t.centre_m[0]]) for i, t in yard.tags.items()
    }
    with pytest.raises(CalibrationError, match=r"without heights, against which the floor leans by 1\.0"):
        calibrate_extrinsics(MODELS, pictures_of(yard, sigma_px=0.02), tags)


def test_floor_that_leans_or_heights_that_do_are_both_told() -> None:
    """A slope of 0.4 degrees contradicts no place: told, with both things that it may be."""
    yard = draw_yard(np.random.default_rng(37), floor_lean_deg=0.4)
    (told,) = doubts(calibrate_extrinsics(MODELS, pictures_of(yard, sigma_px=0.02), yard.tags))
    assert told.startswith("The floor leans by 0.")
    assert "or the measured heights are wrong" in told
