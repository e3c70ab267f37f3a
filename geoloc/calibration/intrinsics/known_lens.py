"""A fitted lens as a result file keeps it: numbers and their covariance, without corners and boards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.intrinsics.fit import MODELS, Fit, lenses, ray_slopes
from geoloc.calibration.intrinsics.lens import Lens
from geoloc.cameras import CameraModel
from geoloc.errors import CalibrationError


@dataclass(frozen=True, slots=True)
class KnownLens:
    """A lens with the covariance of its parameters.

    Attributes
    ----------
    lens : Lens
    k : float64 (p,)
        Its unknowns, in the lens's own units.
    covariance : float64 (p, p)
        Of `k`.
    """

    lens: Lens
    k: FloatArray
    covariance: FloatArray

    @property
    def camera(self) -> CameraModel:
        """The camera model with these numbers."""
        return self.lens.camera(self.k)

    def ray_slopes(self, ray: FloatArray) -> FloatArray:
        """Derivatives (n, 3, p) of the pixels' unit rays (n, 3) by the unknowns."""
        return ray_slopes(self.lens, self.k, ray)


def lens_of_fit(fit: Fit) -> KnownLens:
    """Take the lens out of a fit."""
    n = len(fit.lens.parameters)
    return KnownLens(fit.lens, fit.adjusted.state.lens, fit.adjusted.covariance[:n, :n])


def known_lens(
    parameters: Sequence[str],
    values: FloatArray,
    covariance: FloatArray,
    width_px: int,
    height_px: int,
) -> KnownLens:
    """Find the lens whose parameters have these names.

    Parameters
    ----------
    parameters : sequence of str
        As `Lens.parameters` names them.
    values : float64 (p,)
    covariance : float64 (p, p)
        Both in the units of calibration files, as `Fit.values` and `Fit.covariance` give them.
    width_px, height_px : int

    Raises
    ------
    CalibrationError
        If no lens has them, or the numbers are not as many.
    """
    for model, linear in product(MODELS, (False, True)):
        for lens in lenses(model, width_px, height_px, linear=linear):
            if lens.parameters == tuple(parameters):
                n = len(lens.parameters)
                if values.shape != (n,) or covariance.shape != (n, n):
                    break
                return KnownLens(lens, values / lens.units, covariance / np.outer(lens.units, lens.units))
    raise CalibrationError(
        f"No camera model of twin has {len(values)} parameters named {', '.join(parameters)} with a "
        "covariance of that size: was the result file changed?"
    )
