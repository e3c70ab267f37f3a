"""Kartverket's and NKG's own grids: the official shift to EUREF89, and heights in NN2000."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from typing import Any

import pytest
from checkout import REAL

GRIDS = REAL / "proj_grids"

CODE = """
import json, sys
import numpy as np
from geoloc.earth.datum import euref89_from_itrf
from geoloc.earth.geodesy import enu_offset
from geoloc.earth.heights import ellipsoidal_from_nn2000, nn2000_from_ellipsoidal

def shift(frame, lat, lon, year):
    moved = euref89_from_itrf(frame, lat, lon, 80.0, year)
    east, north = enu_offset(lat, lon, moved.latitude_deg, moved.longitude_deg)
    return [*map(float, (east, north, moved.height_m - 80.0)), moved.extra_sigma_m, moved.how]

places = [63.42, 59.91, 60.39, 69.65, 48.0, np.nan], [10.40, 10.75, 5.32, 18.96, 16.0, 10.0]
up = nn2000_from_ellipsoidal(*places, 80.0)
back = ellipsoidal_from_nn2000(*places, up.height_m)
print(json.dumps({
    "ITRF2014": shift("ITRF2014", 63.42, 10.40, 2026.9),
    "ITRF2020": shift("ITRF2020", 63.42, 10.40, 2026.9),
    "Vienna": shift("ITRF2020", 48.2, 16.4, 2026.9),
    "geoid": (80.0 - up.height_m).tolist(),
    "back": back.height_m.tolist(),
    "sigma": up.sigma_m,
    "how": up.how,
}))
"""


@pytest.fixture(scope="module")
def answers() -> dict[str, Any]:
    """What a process says that finds the grids where PROJ looks for a user's own."""
    if not GRIDS.exists():
        pytest.skip("the real data proj_grids are not beside the checkout")
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        env={**os.environ, "PROJ_USER_WRITABLE_DIRECTORY": str(GRIDS), "PROJ_NETWORK": "OFF"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    said: dict[str, Any] = json.loads(done.stdout)
    return said


@pytest.mark.parametrize(
    ("frame", "official_m"),
    [("ITRF2014", (-0.508, -0.670, -0.160)), ("ITRF2020", (-0.510, -0.667, -0.160))],
)
def test_euref89_by_the_grids_is_the_official_shift(
    answers: dict[str, Any], frame: str, official_m: tuple[float, float, float]
) -> None:
    """Trondheim at 2026.9: east, north and up of NKG2020, as PROJ computes it, to the millimetre."""
    *shift_m, sigma_m, how = answers[frame]
    assert shift_m == pytest.approx(official_m, abs=0.0006)
    assert sigma_m == 0.02
    assert how == f"Positions brought from {frame} to EUREF89 by the NKG2020 grids."


def test_euref89_outside_the_grids_goes_without_them_and_says_so(answers: dict[str, Any]) -> None:
    """Vienna is not covered: the European transformation, with its larger sigma, instead of nothing."""
    east, north, _, sigma_m, how = answers["Vienna"]
    assert 0.5 < (east**2 + north**2) ** 0.5 < 1.2
    assert sigma_m == 0.045
    assert "outside the NKG2020 grids" in how


def test_nn2000_is_below_the_ellipsoid_by_the_geoid(answers: dict[str, Any]) -> None:
    """Trondheim, Oslo, Bergen, Tromsø as HREF2018B has them; Austria and NaN are unknown."""
    assert answers["geoid"][:4] == pytest.approx([39.418, 39.104, 45.007, 31.144], abs=0.015)
    assert all(math.isnan(value) for value in answers["geoid"][4:])
    assert answers["sigma"] == 0.02
    assert answers["how"] == "NN2000 by the geoid model HREF2018B."


def test_nn2000_and_back_closes(answers: dict[str, Any]) -> None:
    """The ellipsoidal height comes back to a hundredth of a millimetre."""
    assert answers["back"][:4] == pytest.approx([80.0] * 4, abs=1e-5)
