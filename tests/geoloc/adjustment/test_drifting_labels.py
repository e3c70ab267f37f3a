"""Labels whose errors last for seconds count as fewer, and clicks count in full."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import Recording, recorded

from geoloc.locate.accuracy import nees
from geoloc.simulation.noise import gauss_markov, stream

LASTS_S = 2.0


def drifting(recording: Recording, sigma_px: float) -> Recording:
    """All labels of a camera wander together."""
    pixel = recording.pixel_px.copy()
    for name in np.unique(recording.camera):
        rows = np.flatnonzero(recording.camera == name)
        epochs, of = np.unique(recording.epoch_ns[rows], return_inverse=True)
        time_s = 1e-9 * (epochs - epochs[0])
        for axis in (0, 1):
            wander = gauss_markov(stream(axis, f"label {name}"), time_s, sigma_px, LASTS_S)
            pixel[rows, axis] += wander[of]
    return recording._replace(pixel_px=pixel)


@pytest.mark.parametrize("name", ["urban", "highway"])
def test_labels_that_drift_get_larger_ellipses_that_hold(name: str) -> None:
    """Clicks are taken as they are; labels that wander by 5 px over 2 s are noisier than their scatter."""
    recording = recorded(name, seed=4)
    clicked, drifted = recording.adjusted(), drifting(recording, 5.0)
    assert clicked.noise == pytest.approx(1.0, abs=0.1)
    adjusted = drifted.adjusted()
    used = adjusted.used
    scatter = float(np.sqrt(np.mean(adjusted.residual_px[used] ** 2))) / 1.5
    assert adjusted.noise > 1.5 * scatter
    inside = nees(drifted.errors_m(adjusted), adjusted.covariance_m2) < 5.991
    assert np.mean(inside) >= 0.85
