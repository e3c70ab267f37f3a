"""Surveyed objects against a drive: far from where they were seen, or not where the cameras see them."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import FloatArray, TextArray
from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.trajectory.trajectory import Poses
from twin.errors import TruthError
from twin.reports.zones import system_that_fits

_FAR_M = 200.0
_SIGMAS = 5.0
_LEAST_OBJECTS = 5
_LEAST_M = 0.3
"""What a foot is off by at any survey: the pole's lean, kerbs, the car's own place."""


def check_near(objects: TextArray, truth_m: FloatArray, poses: Poses, epsg: int) -> None:
    """Refuse objects that were surveyed far from every place where they were annotated.

    Parameters
    ----------
    objects : str (n,)
        Object of each sighting.
    truth_m : float64 (n, 2)
        Its east and north, EPSG:25833.
    poses : Poses (n,)
    epsg : int
        The system of the survey's own numbers.

    Raises
    ------
    TruthError
        More than 200 m away: which object, how far, and in which system the numbers would fit.
    """
    eye = np.column_stack(utm33_from_geographic(poses.latitude_deg, poses.longitude_deg))
    away = np.hypot(*(truth_m - eye).T)
    names, of = np.unique(objects, return_inverse=True)
    nearest = np.full(len(names), np.inf)
    np.fmin.at(nearest, of, away)
    far = np.flatnonzero(nearest > _FAR_M)
    if not far.size:
        return
    worst = far[nearest[far].argmax()]
    others = f" (and {far.size - 1} more)" if far.size > 1 else ""
    astray = np.isin(of, far)
    cure = system_that_fits(
        truth_m[astray], epsg, lambda at_m: float(np.median(np.hypot(*(at_m - eye[astray]).T)))
    )
    raise TruthError(
        f"Object {names[worst]}{others} was surveyed {nearest[worst]:,.0f} m from every place where this"
        f" drive sees it: {cure or 'is it the object that was annotated by this name?'}"
    )


def most_misplaced(
    objects: TextArray, offset_m: FloatArray, covariance_m2: FloatArray
) -> tuple[str, float] | None:
    """Find the object that lies furthest from where the cameras see it, beyond what objects do.

    An object's offset is the mean of its sightings' offsets, weighted by their covariances, and told in
    sigmas of one sighting: what moves the sightings of one object is mostly the same in all of them, and
    along the ray a foot is far less certain than across it. Where objects scatter more than that, their
    scatter is the sigma (the median of a Rayleigh distribution is 1.1774 sigma).

    Parameters
    ----------
    objects : str (n,)
    offset_m : float64 (n, 2)
        Seen less surveyed place, east and north; NaN where not seen.
    covariance_m2 : float64 (n, 2, 2)

    Returns
    -------
    (str, float) or None
        Name and distance; None with fewer than five objects, and where none is beyond five sigmas and 0.3 m.
    """
    use = np.isfinite(offset_m).all(axis=1) & np.isfinite(covariance_m2).all(axis=(1, 2))
    names, of = np.unique(objects[use], return_inverse=True)
    if len(names) < _LEAST_OBJECTS:
        return None
    weight = np.linalg.inv(covariance_m2[use])
    weights, sums = np.zeros((len(names), 2, 2)), np.zeros((len(names), 2))
    np.add.at(weights, of, weight)
    np.add.at(sums, of, np.einsum("nij,nj->ni", weight, offset_m[use]))
    mean = np.linalg.solve(weights, sums[..., np.newaxis])[..., 0]
    one = weights / np.bincount(of)[:, np.newaxis, np.newaxis]
    sigmas = np.sqrt(np.einsum("ni,nij,nj->n", mean, one, mean))
    sigmas /= max(float(np.median(sigmas)) / 1.1774, 1.0)
    metres = np.hypot(*mean.T)
    worst = int(np.where(metres > _LEAST_M, sigmas, 0.0).argmax())
    return (str(names[worst]), float(metres[worst])) if sigmas[worst] > _SIGMAS else None
