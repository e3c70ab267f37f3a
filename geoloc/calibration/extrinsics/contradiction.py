"""Where pictures and measured places contradict each other as a whole: refused, with what explains it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.extrinsics.initial_guess import chained, laid_onto_rig
from geoloc.calibration.extrinsics.network import Network, NetworkState
from geoloc.calibration.extrinsics.observations import Pose, Sighting, Sigmas, Tag, TagPicture
from geoloc.calibration.extrinsics.outliers import NetworkFit, fit_without_outliers
from geoloc.calibration.extrinsics.rays import sightings_in
from geoloc.calibration.extrinsics.solve import adjust_network, angle_step, solve_network
from geoloc.cameras.base import CameraModel
from geoloc.errors import CalibrationError

FAIR_PX = 0.25
"""Corners of a camera fit better than this. Rendered tags do to 0.01-0.03 px; pictures with a blur of 3 px
to 0.04-0.28, and those of another camera of the same rig to 0.35."""
MOST_PX = 1.0
"""Corners of a camera that are further off than this fit no layout."""
_FEWEST_OUT, _PART_OUT = 3, 1.0 / 3.0
"""So many measured places, and more than that part of them, are not slips of the tape."""
_ANY_REASON = (
    ": check that places are x forward, y left, z up in metres, the tags' ids and sizes, the cameras'"
    " intrinsics (focal length, picture size, lens), and that neither the car nor a tag was moved"
)
_CLEARLY = 0.5
"""Of the residuals that two cameras have with their own pictures: exchanged pictures fit better than that."""
_ANGLE_ROUNDS = 4
_SURE = 4.0
_LEAST_ANGLE, _MOST_ANGLE = 0.001, 0.2


def first_state(
    models: Mapping[str, CameraModel],
    pictures: Sequence[TagPicture],
    tags: Mapping[int, Tag],
    nominal: Mapping[str, Pose],
) -> tuple[list[Sighting], NetworkState]:
    """Sightings of all tags that can be placed, and a first guess of every pose.

    Raises
    ------
    CalibrationError
        If no camera on the car sees a tag, or a picture shows one twice.
    """
    sightings = sightings_in(models, pictures, tags)
    groups = [laid_onto_rig(group, tags, nominal) for group in chained(sightings)]
    state = NetworkState(
        {name: pose for group in groups for name, pose in group.views.items()},
        {tag: pose for group in groups for tag, pose in group.tags.items()},
    )
    return [s for s in sightings if s.tag in state.tags], state


def is_contradicted(fitted: NetworkFit, tags: Mapping[int, Tag]) -> bool:
    """Whether too many measured places fell out to be slips of the tape."""
    measured = [tag for tag in fitted.state.tags if np.isfinite(tags[tag].places_m()).any()]
    out = len(fitted.misplaced)
    return out >= _FEWEST_OUT and out > _PART_OUT * len(measured)


def refuse_contradictions(
    fitted: NetworkFit,
    sightings: Sequence[Sighting],
    models: Mapping[str, CameraModel],
    pictures: Sequence[TagPicture],
    tags: Mapping[int, Tag],
    sigmas: Sigmas,
) -> None:
    """Refuse what fits badly as a whole, and say why where that can be told.

    Tried are the pictures of two cameras exchanged, and one focal length of each camera.

    Raises
    ------
    CalibrationError
        If pictures are exchanged, if measured places contradict the pictures as a whole, or if corners of a
        camera are off by more than a pixel.
    """
    off_px, worst = max((px, camera) for camera, px in fitted.network.corner_px.items())
    contradicted = is_contradicted(fitted, tags)
    if off_px <= FAIR_PX and not contradicted:
        return
    exchanged = _exchanged(fitted, models, pictures, tags, sigmas)
    if exchanged is not None:
        first, second, now_px = exchanged
        raise CalibrationError(
            f"The pictures of {first} and {second} seem to be exchanged: corners fit to {off_px:.2f} px as"
            f" they are named, and to {now_px:.2f} px the other way round. Name each after its own camera."
        )
    if not contradicted and off_px <= MOST_PX:
        return
    what = (
        f"The measured places contradict the pictures as a whole: {len(fitted.misplaced)} of them do not fit"
        if contradicted
        else f"The layout does not fit the pictures: corners of {worst} are off by {off_px:.1f} px"
    )
    reason = _heights(fitted, sightings, tags, sigmas) or _focal_lengths(fitted, sightings, tags, sigmas)
    raise CalibrationError(f"{what}{reason or _ANY_REASON}.")


def _exchanged(
    fitted: NetworkFit,
    models: Mapping[str, CameraModel],
    pictures: Sequence[TagPicture],
    tags: Mapping[int, Tag],
    sigmas: Sigmas,
) -> tuple[str, str, float] | None:
    """Two cameras of one picture size that fit clearly better with each other's pictures, and how well."""
    before = fitted.network.corner_px
    on_car = sorted({p.camera for p in pictures if p.on_car} & before.keys())
    best = None
    for first, second in combinations(on_car, 2):
        one, other, limit = models[first], models[second], max(before[first], before[second])
        if (one.width_px, one.height_px) != (other.width_px, other.height_px) or limit <= FAIR_PX:
            continue
        named = {first: second, second: first}
        renamed = [replace(p, camera=named.get(p.camera, p.camera)) for p in pictures]
        sightings, state = first_state(models, renamed, tags, {})
        after = adjust_network(sightings, tags, sigmas, state, robust=True)[0].corner_px
        now_px = max(after.get(first, np.inf), after.get(second, np.inf))
        if now_px < _CLEARLY * limit and (best is None or now_px < best[2]):
            best = first, second, now_px
    return best


def _heights(
    fitted: NetworkFit, sightings: Sequence[Sighting], tags: Mapping[int, Tag], sigmas: Sigmas
) -> str | None:
    """What to say of the measured heights, if everything fits without them and the floor is level then."""
    if fitted.floor is None or not fitted.floor.leans:
        return None
    flat = {number: _without_height(tag) for number, tag in tags.items()}
    known = [s for s in sightings if s.view in fitted.state.views and s.tag in fitted.state.tags]
    if not _is_mended(known, flat, sigmas, fitted.state):
        return None
    return (
        ", but everything fits without heights, against which the floor leans by"
        f" {fitted.floor.lean_deg:.1f}°: measure heights from"
        " the ground below the rear axle, or find a level floor"
    )


def _without_height(tag: Tag) -> Tag:
    level = np.array([1.0, 1.0, np.nan])
    return replace(tag, centre_m=tag.centre_m * level, mark_places_m=tag.mark_places_m * level)


def _focal_lengths(
    fitted: NetworkFit, sightings: Sequence[Sighting], tags: Mapping[int, Tag], sigmas: Sigmas
) -> str | None:
    """What to say of the focal lengths, if other ones let everything fit."""
    known = [s for s in sightings if s.view in fitted.state.views and s.tag in fitted.state.tags]
    free = {number: replace(tag, on_floor=False) for number, tag in tags.items()}
    cameras = sorted({s.camera for s in known})
    angle, sigma, state = np.zeros(len(cameras)), np.zeros(len(cameras)), fitted.state
    mended = known
    for _ in range(_ANGLE_ROUNDS):
        network = Network(mended, free, sigmas, dict.fromkeys(cameras, sigmas.corner_px))
        state = solve_network(network, state)
        step, sigma = angle_step(network, state, cameras)
        angle += step
        by_camera = dict(zip(cameras, angle, strict=True))
        mended = [replace(s, ray=_widened(s.ray, by_camera[s.camera])) for s in known]
    if np.abs(angle).max() > _MOST_ANGLE or not _is_mended(mended, tags, sigmas, state):
        return None
    sure = np.abs(angle) > np.maximum(_SURE * sigma, _LEAST_ANGLE)
    longer = 100.0 * (1.0 / (1.0 + angle) - 1.0)
    told = [
        f"{name}'s {abs(part):.1f} % {'longer' if part > 0.0 else 'shorter'}"
        for name, part, shown in zip(cameras, longer, sure, strict=True)
        if shown
    ]
    if not told:
        return None
    return (
        f", but everything fits with other focal lengths than the intrinsics state ({', '.join(told)}):"
        " calibrate the intrinsics again, and see that they are of this lens and this picture size"
    )


def _is_mended(
    sightings: Sequence[Sighting], tags: Mapping[int, Tag], sigmas: Sigmas, state: NetworkState
) -> bool:
    """Whether everything fits now."""
    try:
        again = fit_without_outliers(sightings, tags, sigmas, state)
    except CalibrationError:
        return False
    level = again.floor is None or not again.floor.leans
    fits = max(again.network.corner_px.values()) <= FAIR_PX
    return level and fits and not is_contradicted(again, tags)


def _widened(ray: FloatArray, part: float) -> FloatArray:
    """Unit rays (..., 3) with their angles from the optical axis larger by a part of them."""
    across = np.linalg.norm(ray[..., :2], axis=-1, keepdims=True)
    angle = (1.0 + part) * np.arctan2(across, ray[..., 2:])
    outward = ray[..., :2] / np.maximum(across, 1e-12)
    return np.concatenate([np.sin(angle) * outward, np.cos(angle)], axis=-1)
