"""Two fits of one lens compared: where their rays part, but for a rotation, and whether chance explains it.

The axes of a camera are those of its lens's formula. Another fit may put them a little elsewhere: rays of all
pixels are then turned alike, and the mounting's angles turn back. So one common rotation is taken out first
(mrcal's implied transformation, https://mrcal.secretsauce.net/differencing.html, for rays, which have no
origin).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.intrinsics.fit import tangents
from geoloc.calibration.intrinsics.known_lens import KnownLens
from geoloc.cameras import CameraModel

_LEAST_PIXELS = 3
_SMALLEST_RAD = 1e-10
"""Added to the sigma of a ray: below it files round their numbers."""


@dataclass(frozen=True, slots=True)
class LensDifference:
    """Where the rays of two fits part.

    Attributes
    ----------
    rotation : float64 (3, 3)
        Takes rays of the first to those of the second, as well as one rotation can.
    apart_rad : float64 (n, 3)
        Second less turned first, in the second's camera frame (RDF); NaN where either has no ray.
    covariance : float64 (n, 3, 3) or None
        Of `apart_rad` if both fits are right, rad²; None where a fit has no covariance.
    mean_square : float or None
        Mean of the squared differences in units of their covariance: 1 is what chance gives on average.
    by_chance : float or None
        Probability that chance alone makes `mean_square` as large.
    """

    rotation: FloatArray
    apart_rad: FloatArray
    covariance: FloatArray | None = None
    mean_square: float | None = None
    by_chance: float | None = None

    @property
    def angle_rad(self) -> FloatArray:
        """(n,): angle between the rays."""
        return np.asarray(np.linalg.norm(self.apart_rad, axis=-1))

    @property
    def sigma_rad(self) -> FloatArray | None:
        """(n,): one sigma of the angle that chance gives, along the longer axis."""
        if self.covariance is None:
            return None
        known = np.asarray(np.isfinite(self.covariance).all(axis=(1, 2)))
        sigma = np.full(known.shape, np.nan)
        sigma[known] = np.sqrt(np.linalg.eigvalsh(self.covariance[known])[:, -1])
        return sigma


def lens_difference(
    first: CameraModel,
    second: CameraModel,
    pixel_px: FloatArray,
    known: tuple[KnownLens, KnownLens] | None = None,
) -> LensDifference:
    """Compare the rays of pixels (n, 2).

    Parameters
    ----------
    first, second : CameraModel
        Of the same image size.
    pixel_px : float64 (n, 2)
        Pixels that both fits vouch for, evenly spread: each counts alike for the common rotation.
    known : pair of KnownLens, optional
        The same two lenses with their covariances, from independent data.

    Notes
    -----
    With J the derivatives of all differences by both lenses' unknowns, what the rotation takes up of them
    taken off, the mean square is a sum of squares of normal numbers with weights that add up to 1. Its
    distribution is taken as a multiple of χ² with the same mean and variance (Satterthwaite 1946).
    """
    (a, inside_a), (b, inside_b) = (c.camera_ray_from_pixel(pixel_px) for c in (first, second))
    used = inside_a & inside_b
    apart = np.full((len(pixel_px), 3), np.nan)
    if used.sum() < _LEAST_PIXELS:
        return LensDifference(np.eye(3), apart)
    rotation = _rotation(a[used], b[used])
    turned = a[used] @ rotation.T
    apart[used] = b[used] - turned
    if known is None:
        return LensDifference(rotation, apart)
    slopes, joint = _slopes(known, rotation, a[used], b[used])
    part = slopes @ joint @ np.swapaxes(slopes, -1, -2)
    covariance = np.full((len(pixel_px), 3, 3), np.nan)
    covariance[used] = part
    mean_square, by_chance = _judged(turned, apart[used], slopes, joint)
    return LensDifference(rotation, apart, covariance, mean_square, by_chance)


def _rotation(a: FloatArray, b: FloatArray) -> FloatArray:
    """Rotation that takes rays a to rays b by least squares (Kabsch 1976)."""
    u, _, v = np.linalg.svd(b.T @ a)
    return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)


def _slopes(
    known: tuple[KnownLens, KnownLens], rotation: FloatArray, a: FloatArray, b: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (n, 3, p) by both lenses' unknowns, the rotation adjusted, and the unknowns' covariance."""
    by_first, by_second = (lens.ray_slopes(ray) for lens, ray in zip(known, (a, b), strict=True))
    slopes = np.concatenate([-rotation @ by_first, by_second], axis=-1)
    slopes = without_common_turn(slopes, a @ rotation.T)
    n = [len(lens.k) for lens in known]
    joint = np.zeros((sum(n), sum(n)))
    joint[: n[0], : n[0]], joint[n[0] :, n[0] :] = known[0].covariance, known[1].covariance
    return slopes, joint


def without_common_turn(slopes: FloatArray, ray: FloatArray) -> FloatArray:
    """Derivatives (n, 3, p) of rays (n, 3) less the rotation of all of them that comes nearest (n, 3, p)."""
    normal = len(ray) * np.eye(3) - ray.T @ ray
    moment = np.cross(ray[:, np.newaxis], np.swapaxes(slopes, -1, -2)).sum(axis=0)
    turn = np.linalg.solve(normal, moment.T)
    return np.asarray(slopes - np.swapaxes(np.cross(turn.T, ray[:, np.newaxis]), -1, -2))


def _judged(ray: FloatArray, apart: FloatArray, slopes: FloatArray, joint: FloatArray) -> tuple[float, float]:
    """Mean square of the differences in units of their covariance, and how probable it is by chance."""
    from scipy.stats import chi2

    across = np.swapaxes(tangents(ray), -1, -2)
    off, by_lens = (across @ apart[:, :, np.newaxis])[:, :, 0], across @ slopes
    each = by_lens @ joint @ np.swapaxes(by_lens, -1, -2) + _SMALLEST_RAD**2 * np.eye(2)
    weight = np.linalg.inv(each)
    mean_square = float(np.einsum("ni,nij,nj->", off, weight, off)) / (2.0 * len(ray))
    normal = np.einsum("nip,nij,njq->pq", by_lens, weight, by_lens) / (2.0 * len(ray))
    # Tr (N C)²: the sum of the squared weights, whose sum Tr N C is 1.
    shared = normal @ joint
    freedom = np.trace(shared) ** 2 / np.trace(shared @ shared)
    return mean_square, float(chi2.sf(mean_square * freedom, freedom))
