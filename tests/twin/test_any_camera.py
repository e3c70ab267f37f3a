"""The same drive with its lens described by another tool's model: the same signs in the same places."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa

from geoloc.calibration_files.kalibr import kalibr_text
from geoloc.calibration_files.ocamcalib import ocamcalib_text
from geoloc.cameras import FisheyeCamera, FThetaCamera, OcamCamera
from geoloc.cameras.monotonic import polynomial
from geoloc.simulation.car import CAMERAS
from geoloc.simulation.simulate import scenario, simulate_drive
from twin.ingest.ingest import ingest_drive
from twin.samples.write_drive import write_driveworks_trip
from twin.store import schema
from twin.store.schema import METHODS
from twin.store.store import Store

WIDE = "C3_tricam120"
LENS = CAMERAS[WIDE][0]
RADIUS_PX = np.linspace(1.0, 1130.0, 400)
"""To the corners of the image."""


def lens_as_fisheye() -> FisheyeCamera:
    """Kannala-Brandt's four coefficients, fitted to the simulated lens."""
    theta = polynomial(LENS.theta_from_r or (), RADIUS_PX)
    powers = theta[:, np.newaxis] ** np.array([1, 3, 5, 7, 9])
    focal, *odd = np.linalg.lstsq(powers, RADIUS_PX, rcond=None)[0]
    distortion = tuple(float(k / focal) for k in odd)
    return FisheyeCamera(
        LENS.width_px, LENS.height_px, float(focal), float(focal), LENS.cx_px, LENS.cy_px, distortion
    )


def lens_as_ocam() -> OcamCamera:
    """Scaramuzza's polynomial, fitted to the simulated lens."""
    depth = RADIUS_PX / np.tan(polynomial(LENS.theta_from_r or (), RADIUS_PX))
    powers = (RADIUS_PX[:, np.newaxis] / 1000.0) ** np.array([0, 2, 3, 4, 5, 6])
    first, *others = np.linalg.lstsq(powers, -depth, rcond=None)[0]
    scaled = (float(a) / 1000.0**power for power, a in enumerate(others, start=2))
    return OcamCamera(LENS.width_px, LENS.height_px, LENS.cx_px, LENS.cy_px, (float(first), 0.0, *scaled))


LENSES: dict[str, Callable[[], str]] = {
    "kalibr": lambda: kalibr_text([lens_as_fisheye()]),
    "ocamcalib": lambda: ocamcalib_text(lens_as_ocam()),
}


def ingested(folder: Path, method: str) -> dict[str, tuple[float, float]]:
    """Ingest a drive into a store of its own: easting and northing of each object."""
    with Store.open(folder / f"{method}.db") as store:
        ingest_drive(store, folder, method=method)
        rows = store.rows(sa.select(schema.estimate))
    return {row["object"]: (row["east_m"], row["north_m"]) for row in rows}


@pytest.fixture(scope="module")
def trip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated approach to one sign."""
    folder = tmp_path_factory.mktemp("approach")
    write_driveworks_trip(simulate_drive(scenario("approach"), seed=3), folder)
    return folder


@pytest.fixture(scope="module")
def places(trip: Path) -> dict[str, dict[str, tuple[float, float]]]:
    """Where each method finds the objects with the lens that was simulated."""
    return {method: ingested(trip, method) for method in METHODS}


@pytest.mark.parametrize("lens", [lens_as_fisheye, lens_as_ocam])
def test_fitted_lens_is_the_simulated_one(lens: Callable[[], FisheyeCamera | OcamCamera]) -> None:
    """Over the whole image within 0.02 degrees: what the test below leaves to the models is not more."""
    u, v = np.meshgrid(np.linspace(0.0, 1919.0, 40), np.linspace(0.0, 1207.0, 30))
    pixel = np.stack([u, v], axis=-1)
    assert isinstance(LENS, FThetaCamera)
    (ray, seen), (truth, _) = lens().camera_ray_from_pixel(pixel), LENS.camera_ray_from_pixel(pixel)
    assert seen.all()
    assert np.degrees(np.linalg.norm(ray - truth, axis=-1)).max() < 0.02


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", LENSES)
def test_drive_with_another_tools_calibration_finds_the_same_places(
    trip: Path,
    places: dict[str, dict[str, tuple[float, float]]],
    tmp_path: Path,
    kind: str,
    method: str,
) -> None:
    """Kalibr's fisheye and OCamCalib's model instead of DriveWorks' f-theta: every object within 1 cm."""
    expected = places[method]
    folder = Path(shutil.copytree(trip, tmp_path / "trip", ignore=shutil.ignore_patterns("*.db*")))
    (folder / "lens.calibration").write_text(LENSES[kind]())
    toml = folder / "drive.toml"
    toml.write_text(f'{toml.read_text()}\n[cameras.{WIDE}]\nintrinsics = "lens.calibration"\n')
    found = ingested(folder, method)
    assert expected
    assert found.keys() == expected.keys()
    for name, place in expected.items():
        assert np.hypot(*np.subtract(found[name], place)) < 0.01
