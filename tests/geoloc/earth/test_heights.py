"""NN2000 without Kartverket's geoid model: unknown, and never the ellipsoidal height by another name.

With the model: ``tests/real/test_grids.py``.
"""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Transformer

from geoloc.earth.heights import ellipsoidal_from_nn2000, nn2000_from_ellipsoidal


@pytest.fixture(autouse=True)
def without_model() -> None:
    """Skip where somebody has installed the model: then heights are known."""
    if not np.isnan(nn2000_from_ellipsoidal([], [], []).sigma_m):
        pytest.skip("HREF2018B is installed on this machine")


def test_nn2000_without_the_model_is_unknown_and_says_so() -> None:
    """NaN of the right shape, a NaN sigma, and where to read how to install the model."""
    for heights in (
        nn2000_from_ellipsoidal([[63.42], [59.91]], 10.40, 80.0),
        ellipsoidal_from_nn2000([[63.42], [59.91]], 10.40, 80.0),
    ):
        assert heights.height_m.shape == (2, 1)
        assert np.isnan(heights.height_m).all()
        assert np.isnan(heights.sigma_m)
        assert "HREF2018B is not installed" in heights.how
        assert "`twin help datum-and-heights`" in heights.how


def test_proj_itself_would_pass_the_height_through() -> None:
    """The trap that the named grid closes: asked by CRS, PROJ answers 80 m for 80 m, 39 m wrong."""
    silent = Transformer.from_crs("EPSG:4937", "EPSG:5973", always_xy=True)
    assert silent.transform(10.40, 63.42, 80.0)[2] == 80.0
    assert np.isnan(nn2000_from_ellipsoidal(63.42, 10.40, 80.0).height_m)
