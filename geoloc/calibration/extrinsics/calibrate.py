"""From pictures of tags to the extrinsics of every camera, without what does not fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.calibration.extrinsics.contradiction import refuse_contradictions
from geoloc.calibration.extrinsics.network import Network, NetworkState
from geoloc.calibration.extrinsics.observations import Pose, Sighting, Sigmas, Tag, TagPicture
from geoloc.calibration.extrinsics.outliers import NetworkFit, fit_without_outliers
from geoloc.calibration.extrinsics.solve import covariance_of
from geoloc.calibration.extrinsics.tilted_floor import Floor
from geoloc.calibration.extrinsics.turned_prints import as_printed
from geoloc.calibration.extrinsics.wrong_size import OwnSize, own_sizes
from geoloc.cameras.base import CameraModel


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
    state : NetworkState
        Also of the tags and of cameras that were carried around.
    sightings : tuple of Sighting
    residual_px : float64 (n, 4, 2)
    used : bool (n,)
        False for sightings left out as outliers.
    sigma_px : mapping of camera to float
        Of a corner's coordinate, from the residuals.
    misplaced : mapping of tag to metres
        Measured places that contradict the others, with how far they are off: left out.
    bumps : mapping of tag to metres
        Floor tags that do not lie on the floor, with their height: that they do was left out.
    swapped : tuple of pairs of tags
        Those of `misplaced` of which each was found at the other one's place.
    own_size : mapping of tag to OwnSize
        Tags that were left out somewhere, and fit with another size than the layout's.
    turned : tuple of int
        Tags whose print is turned by 180° against the corners that the layout names: taken so.
    floor : Floor or None
        A floor that leans was not used.
    scale, scale_sigma : float
        Relative error of the tags' sizes.
    tag_sigma_m : mapping of id to float64 (3,)
    network : Network
    """

    cameras: Mapping[str, CameraPose]
    state: NetworkState
    sightings: tuple[Sighting, ...]
    residual_px: FloatArray
    used: BoolArray
    sigma_px: Mapping[str, float]
    misplaced: Mapping[int, float]
    bumps: Mapping[int, float]
    swapped: tuple[tuple[int, int], ...]
    own_size: Mapping[int, OwnSize]
    turned: tuple[int, ...]
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
        If no camera on the car sees a tag, if measured places contradict the pictures as a whole, if the
        pictures of two cameras seem exchanged, or if corners of a camera are off by more than a pixel.

    Notes
    -----
    Förstner and Wrobel, "Photogrammetric Computer Vision" (2016), chapter 15: bundle adjustment with
    observed points. Weights by Huber's function; the corners' sigma is the variance component of the
    residuals over their redundancy.
    """
    stated = sigmas or Sigmas()
    sightings, state, printed, turned = as_printed(models, pictures, tags, nominal or {})
    fitted = fit_without_outliers(sightings, printed, stated, state)
    refuse_contradictions(fitted, sightings, models, pictures, printed, stated)
    found = _result(fitted, sightings, pictures)
    return replace(found, turned=turned, own_size=own_sizes(fitted, sightings, printed, stated))


def _result(fitted: NetworkFit, sightings: Sequence[Sighting], pictures: Sequence[TagPicture]) -> Extrinsics:
    network, state = fitted.network, fitted.state
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
            n_outliers=int((mine & ~fitted.used).sum()),
            rms_px=float(np.sqrt(np.mean(residual[mine & fitted.used] ** 2))),
        )
    places = {tag: network.tag_columns(tag) for tag in network.tag_ids}
    return Extrinsics(
        cameras=cameras,
        state=state,
        sightings=tuple(sightings),
        residual_px=residual,
        used=fitted.used,
        sigma_px=network.corner_px,
        misplaced=fitted.misplaced,
        bumps=fitted.bumps,
        swapped=fitted.swapped,
        own_size={},
        turned=(),
        floor=fitted.floor,
        scale=state.scale,
        scale_sigma=float(np.sqrt(covariance[-1, -1])),
        tag_sigma_m={tag: np.sqrt(np.diag(covariance[at, at])[3:]) for tag, at in places.items()},
        network=network,
    )
