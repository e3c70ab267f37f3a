"""From pictures of tags to the extrinsics of every camera, without what does not fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geoloc.calibration.extrinsics.floor import Floor, lean_of_floor
from geoloc.calibration.extrinsics.network import Network, State
from geoloc.calibration.extrinsics.observed import Pose, Sighting, Sigmas, Tag, TagPicture
from geoloc.calibration.extrinsics.solve import adjusted, covariance_of
from geoloc.calibration.extrinsics.start import chained, laid_onto_rig
from geoloc.cameras.base import CameraModel
from geoloc.errors import CalibrationError

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

OUTLIER_SIGMAS = 6.0
"""A tag whose worst corner is further off, in a picture, is left out: a hand on the tag, a wrong id."""
MISTAPED_SIGMAS = 5.0
"""A measured place that is further from where the pictures put the tag is a slip of the tape."""
_ANY_SIZE = 0.2
"""Sigma of the tags' scale that lets the pictures say it."""
MOST_PX = 3.0
"""Corners of a camera that are further off than this fit no layout."""
_LEAST_SPARE = 0.02
"""Part of a measurement's variance that the rest must be able to check."""


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Extrinsics of one camera.

    Attributes
    ----------
    camera : str
    rig_T_camera : Pose
        Camera axes RDF, rig axes FLU.
    covariance : float64 (6, 6)
        Of a small rotation about the rig's x, y and z (radians), then of the position (metres).
    n_sightings, n_outliers : int
    rms_px : float
        Of the corners that were used, each coordinate.
    """

    camera: str
    rig_T_camera: Pose
    covariance: FloatArray
    n_sightings: int
    n_outliers: int
    rms_px: float

    @property
    def sigma_deg(self) -> FloatArray:
        """One sigma (3,) of the rotation about the rig's x, y, z axes: roll, pitch, yaw of a camera ahead."""
        return np.rad2deg(np.sqrt(np.diag(self.covariance)[:3]))

    @property
    def sigma_m(self) -> FloatArray:
        """One sigma (3,) of the position."""
        return np.sqrt(np.diag(self.covariance)[3:])


@dataclass(frozen=True, slots=True)
class Extrinsics:
    """Result of the adjustment.

    Attributes
    ----------
    cameras : mapping of name to CameraPose
    state : State
        Also of the tags and of cameras that were carried around.
    sightings : tuple of Sighting
    residual_px : float64 (n, 4, 2)
    used : bool (n,)
        False for sightings left out as outliers.
    sigma_px : mapping of camera to float
        Of a corner's coordinate, from the residuals.
    mistaped : mapping of tag to metres
        Measured places that contradict the others, with how far they are off: left out.
    bumps : mapping of tag to metres
        Floor tags that do not lie on the floor, with their height: that they do was left out.
    floor : Floor or None
        A floor that leans was not used.
    scale, scale_sigma : float
        Relative error of the tags' sizes.
    tag_sigma_m : mapping of id to float64 (3,)
    network : Network
    """

    cameras: Mapping[str, CameraPose]
    state: State
    sightings: tuple[Sighting, ...]
    residual_px: FloatArray
    used: BoolArray
    sigma_px: Mapping[str, float]
    mistaped: Mapping[int, float]
    bumps: Mapping[int, float]
    floor: Floor | None
    scale: float
    scale_sigma: float
    tag_sigma_m: Mapping[int, FloatArray]
    network: Network


def calibrate_extrinsics(
    models: Mapping[str, CameraModel],
    pictures: Sequence[TagPicture],
    tags: Mapping[int, Tag],
    *,
    nominal: Mapping[str, Pose] | None = None,
    sigmas: Sigmas | None = None,
) -> Extrinsics:
    """Find where cameras sit from pictures of AprilTags around the standing car.

    One least-squares adjustment of every corner in every picture: unknowns are the poses of all cameras, of
    all tags and of every picture of a camera that was carried around, and one scale that all tags share.
    What a tape or total station measured enters with its sigma, the floor with its own.

    Parameters
    ----------
    models : mapping of camera name to CameraModel
    pictures : sequence of TagPicture
        Taken while neither the car nor a tag moved.
    tags : mapping of id to Tag
        Tags in the pictures that are not named here are ignored.
    nominal : mapping of camera name to Pose, optional
        Rough poses, from a drawing or an older calibration: a start, and never an observation.
    sigmas : Sigmas, optional

    Raises
    ------
    CalibrationError
        If no camera on the car sees a tag, or too little was measured to say where the rig frame is.

    Notes
    -----
    Förstner and Wrobel, "Photogrammetric Computer Vision" (2016), chapter 15: bundle adjustment with
    observed points. Weights by Huber's function; the corners' sigma is the variance component of the
    residuals over their redundancy.
    """
    sightings = _sightings(models, pictures, tags)
    groups = [laid_onto_rig(group, tags, nominal or {}) for group in chained(sightings)]
    state = State(
        {name: pose for group in groups for name, pose in group.views.items()},
        {tag: pose for group in groups for tag, pose in group.tags.items()},
    )
    sightings = [s for s in sightings if s.tag in state.tags]
    found = _cleaned(sightings, tags, sigmas or Sigmas(), state)
    off_px, worst = max((px, camera) for camera, px in found.network.corner_px.items())
    if off_px > MOST_PX:
        raise CalibrationError(
            f"The layout does not fit the pictures: corners of {worst} are off by {off_px:.0f} px. Check that"
            " places are x forward, y left, z up in metres, tags' ids and sizes, and the rig's intrinsics."
        )
    return _result(found, sightings, pictures)


def _sightings(
    models: Mapping[str, CameraModel], pictures: Sequence[TagPicture], tags: Mapping[int, Tag]
) -> list[Sighting]:
    found = [s for p in pictures for s in _sightings_of(p, models[p.camera], tags)]
    on_car = {p.camera for p in pictures if p.on_car}
    if not any(s.view in on_car for s in found):
        raise CalibrationError(
            "No camera on the car sees a tag or a board of the layout: check the family (36h11), the ids, the"
            " board's description, and that the pictures are sharp; a board on the floor needs large markers."
        )
    return found


def _sightings_of(picture: TagPicture, model: CameraModel, tags: Mapping[int, Tag]) -> list[Sighting]:
    ids = picture.tag_ids.tolist()
    twice = sorted({tag for tag in ids if ids.count(tag) > 1}) if picture.points_m is None else []
    if twice:
        raise CalibrationError(
            f"{picture.name} shows tag {', '.join(map(str, twice))} twice: take one of them away, or print"
            " tags with different ids, and take the pictures again."
        )
    found = []
    for i, tag in enumerate(ids):
        if tag not in tags:
            continue
        rays = model.rays(picture.corners_px[i, :, 0], picture.corners_px[i, :, 1], slopes=True)
        if not rays.inside.all() or rays.by_u is None or rays.by_v is None:
            continue
        slopes = np.stack([np.stack(rays.by_u, axis=-1), np.stack(rays.by_v, axis=-1)], axis=-1)
        found.append(
            Sighting(
                camera=picture.camera,
                view=picture.camera if picture.on_car else f"{picture.camera}/{picture.name}",
                tag=tag,
                picture=picture.name,
                points_m=tags[tag].corners_m() if picture.points_m is None else picture.points_m[i],
                ray=np.stack(rays.ray, axis=-1),
                px_from_ray=np.asarray(np.linalg.pinv(slopes), dtype=np.float64),
            )
        )
    return found


@dataclass(frozen=True, slots=True)
class _Cleaned:
    """The adjustment without what does not fit."""

    network: Network
    state: State
    used: BoolArray
    mistaped: Mapping[int, float]
    bumps: Mapping[int, float]
    floor: Floor | None


def _cleaned(
    sightings: Sequence[Sighting], tags: Mapping[int, Tag], sigmas: Sigmas, state: State
) -> _Cleaned:
    """Leave out, one after the other, the measurement that fits worst.

    Where a tag's corners do not fit, what was measured of its place is suspected first; the picture only if
    they do not fit without it either, and then the place is trusted again.
    """
    used = np.ones(len(sightings), dtype=np.bool_)
    suspected: set[int] = set()
    network, state = adjusted(sightings, tags, replace(sigmas, size=_ANY_SIZE), state, robust=True)
    scale_sigma = float(np.sqrt(covariance_of(network, state)[-1, -1]))
    if abs(state.scale) > max(MISTAPED_SIGMAS * scale_sigma, 3.0 * sigmas.size):
        # Printed in another size than the layout says: the size is what the pictures tell.
        sigmas = replace(sigmas, size=_ANY_SIZE)
    network, state = adjusted(sightings, tags, sigmas, state, robust=True)
    floor = lean_of_floor(network, state)
    if floor is not None and floor.leans:
        tags = {number: replace(tag, on_floor=False) for number, tag in tags.items()}
    while True:
        kept = [s for s, good in zip(sightings, used, strict=True) if good]
        if not kept:
            raise CalibrationError(
                "No tag fits the others: check the tags' size and ids, and that nothing was moved."
            )
        now = {tag: _unmeasured(t) if tag in suspected else t for tag, t in tags.items()}
        state = _within(state, kept)
        network, state = adjusted(kept, now, sigmas, state, robust=True)
        worst, strain = _worst_sighting(network, state)
        if strain > OUTLIER_SIGMAS:
            tag = kept[worst].tag
            if tag not in suspected and _is_measured(tags[tag]):
                suspected.add(tag)
            else:
                suspected.discard(tag)
                used[np.flatnonzero(used)[worst]] = False
            continue
        worst_tag, strain = _worst_place(network, state)
        if strain <= MISTAPED_SIGMAS:
            break
        suspected.add(worst_tag)
    network, state = adjusted(kept, now, sigmas, state, robust=False)
    return _Cleaned(network, state, used, *_contradictions(tags, suspected, state), floor)


def _contradictions(
    tags: Mapping[int, Tag], suspected: set[int], state: State
) -> tuple[dict[int, float], dict[int, float]]:
    """How far suspected tags are from where they were measured, and above the floor."""
    seen = sorted(suspected & state.tags.keys())
    mistaped = {}
    for t in seen:
        here = tags[t].points_m() @ state.tags[t].R.T + state.tags[t].t_m
        if np.isfinite(tags[t].places_m()).any():
            off = np.nan_to_num(here - tags[t].places_m())
            mistaped[t] = float(np.linalg.norm(off, axis=1).max())
    return mistaped, {t: float(state.tags[t].t_m[2]) for t in seen if tags[t].on_floor}


def _is_measured(tag: Tag) -> bool:
    return bool(np.isfinite(tag.places_m()).any() or tag.on_floor)


def _unmeasured(tag: Tag) -> Tag:
    nowhere = np.full_like(tag.mark_places_m, np.nan)
    return replace(tag, centre_m=np.full(3, np.nan), mark_places_m=nowhere, on_floor=False)


def _worst_sighting(network: Network, state: State) -> tuple[int, float]:
    """The sighting with the worst corner, and how many sigmas that is off."""
    sigma_px = np.array([network.corner_px[s.camera] for s in network.sightings])
    off = np.abs(network.corner_residuals_px(state)).max(axis=(1, 2)) / sigma_px
    return int(off.argmax()), float(off.max())


def _worst_place(network: Network, state: State) -> tuple[int, float]:
    """The tag whose measured place, or place on the floor, contradicts the rest most, and by how many sigmas.

    Baarda's test: what is left between a measurement and the adjusted value, over the sigma that it should
    have. A measurement that nothing checks has nothing left, and is never suspected.
    """
    covariance = covariance_of(network, state)
    worst, most = -1, 0.0
    for tag in network.tag_ids:
        measured, at = network.tags[tag], network.tag_columns(tag)
        rest, by_pose, _ = network.measured(measured, state)
        prior = np.full_like(rest, measured.centre_sigma_m**2)
        if measured.on_floor:
            rest[0, 2], prior[0, 2] = state.tags[tag].t_m[2], network.sigmas.floor_m**2 / 4.0
        known = np.einsum("kij,jl,kil->ki", by_pose, covariance[at, at], by_pose)
        spare = prior - known
        tested = np.isfinite(rest) & (spare > _LEAST_SPARE * prior)
        strain = float((np.abs(rest[tested]) / np.sqrt(spare[tested])).max(initial=0.0))
        if strain > most:
            worst, most = tag, strain
    return worst, most


def _within(state: State, kept: Sequence[Sighting]) -> State:
    views, tags = {s.view for s in kept}, {s.tag for s in kept}
    return replace(
        state,
        views={name: pose for name, pose in state.views.items() if name in views},
        tags={tag: pose for tag, pose in state.tags.items() if tag in tags},
    )


def _result(found: _Cleaned, sightings: Sequence[Sighting], pictures: Sequence[TagPicture]) -> Extrinsics:
    network, state = found.network, found.state
    covariance = covariance_of(network, state)
    residual = np.full((len(sightings), 4, 2), np.nan)
    # What was left out everywhere has no pose any more, and no residual either.
    known = np.array([s.view in state.views and s.tag in state.tags for s in sightings])
    shown = [s for s, good in zip(sightings, known, strict=True) if good]
    whole = Network(shown, network.tags, network.sigmas, network.corner_px)
    residual[known] = whole.corner_residuals_px(state)
    cameras = {}
    for name in sorted({p.camera for p in pictures if p.on_car} & set(network.view_names)):
        mine = np.array([s.view == name for s in sightings])
        columns = network.columns(name)
        cameras[name] = CameraPose(
            camera=name,
            rig_T_camera=state.views[name],
            covariance=covariance[columns, columns],
            n_sightings=int(mine.sum()),
            n_outliers=int((mine & ~found.used).sum()),
            rms_px=float(np.sqrt(np.mean(residual[mine & found.used] ** 2))),
        )
    places = {tag: network.tag_columns(tag) for tag in network.tag_ids}
    return Extrinsics(
        cameras=cameras,
        state=state,
        sightings=tuple(sightings),
        residual_px=residual,
        used=found.used,
        sigma_px=network.corner_px,
        mistaped=found.mistaped,
        bumps=found.bumps,
        floor=found.floor,
        scale=state.scale,
        scale_sigma=float(np.sqrt(covariance[-1, -1])),
        tag_sigma_m={tag: np.sqrt(np.diag(covariance[at, at])[3:]) for tag, at in places.items()},
        network=network,
    )
