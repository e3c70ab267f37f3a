"""Ground rasters: cropped to the drive, resampled to EPSG:25833, and never of unknown heights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyproj import Transformer

from geoloc.earth.heights import nn2000_from_ellipsoidal
from twin.errors import TerrainError
from twin.ingest import terrain as module
from twin.ingest.terrain import read_terrain

rasterio = pytest.importorskip("rasterio")
# rasterio 1.4 multiplies affine transforms the way that affine 3 wants to be rid of.
pytestmark = pytest.mark.filterwarnings("ignore:Use `@` matmul:PendingDeprecationWarning")

EAST, NORTH = 270_500.0, 7_040_600.0
"""The middle of the raster and of the drive, in Trondheim."""
DRIVE = (EAST + np.array([-20.0, 0.0, 30.0, np.nan]), NORTH + np.array([-10.0, 0.0, 25.0, np.nan]))


def surface_m(east: Any, north: Any) -> Any:
    """A hillside with a gentle curve: what bilinear resampling keeps to millimetres."""
    x, y = east - EAST, north - NORTH
    return 80.0 + 0.05 * x - 0.03 * y + 1e-4 * x * y


def write(
    path: Path, crs: str, step: float, size: int, *, nodata: float | None = None, **profile: Any
) -> Path:
    """A GeoTIFF of `surface_m`, its middle at the drive, nodes `step` of its CRS apart."""
    x, y = Transformer.from_crs("EPSG:25833", crs, always_xy=True).transform(EAST, NORTH)[:2]
    corner = np.array([round(x / step), round(y / step)]) * step + np.array([-1.0, 1.0]) * step * size / 2
    at = np.arange(size) + 0.5
    grid_x, grid_y = np.meshgrid(corner[0] + at * step, corner[1] - at * step)
    back = Transformer.from_crs(crs, "EPSG:25833", always_xy=True).transform(grid_x, grid_y)
    heights = surface_m(*back[:2]).astype(np.float32)
    if nodata is not None:
        heights[: size // 4] = nodata
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        width=size,
        height=size,
        count=1,
        dtype="float32",
        crs=crs,
        nodata=nodata,
        transform=rasterio.Affine(step, 0.0, corner[0], 0.0, -step, corner[1]),
        **profile,
    ) as file:
        file.write(heights, 1)
    return path


@pytest.mark.parametrize(
    ("crs", "step", "tolerance_m"),
    [("EPSG:25833", 1.0, 1e-4), ("EPSG:25832", 1.0, 3e-3), ("EPSG:4258", 1e-5, 3e-3)],
)
def test_terrain_of_a_raster_has_its_heights(
    tmp_path: Path, crs: str, step: float, tolerance_m: float
) -> None:
    """In its own grid, in the neighbouring zone or in degrees: the surface comes out where it was."""
    path = write(tmp_path / "dtm.tif", crs, step, 600)
    terrain = read_terrain(path, *DRIVE, heights="ellipsoidal")
    places = np.random.default_rng(1).uniform(-80.0, 80.0, (2, 500)) + np.array([[EAST], [NORTH]])
    np.testing.assert_allclose(terrain.height_m(*places), surface_m(*places), atol=tolerance_m)


def test_terrain_is_cropped_to_the_drives_surroundings(tmp_path: Path) -> None:
    """Of 2 km by 2 km only the drive's bounds and the margin are read, on the raster's own nodes."""
    path = write(tmp_path / "country.tif", "EPSG:25833", 1.0, 2000, tiled=True)
    terrain = read_terrain(path, *DRIVE, heights="ellipsoidal", margin_m=100.0)
    rows, columns = terrain.grid_m.shape
    assert (columns, rows) == pytest.approx((250, 235), abs=2)
    assert np.isfinite(terrain.height_m(EAST - 120.0 + 1.0, NORTH - 110.0 + 1.0))
    assert (terrain.east_m % 1.0, terrain.north_m % 1.0) == (0.5, 0.5)
    assert terrain.step_m == 1.0


def test_terrain_without_data_is_nan(tmp_path: Path) -> None:
    """Nodata, declared or absurd, is not known: it is no height."""
    for nodata in (-32767.0, 1e9):
        path = write(tmp_path / "holes.tif", "EPSG:25833", 1.0, 300, nodata=nodata)
        terrain = read_terrain(path, *DRIVE, heights="ellipsoidal", margin_m=140.0)
        assert np.isnan(terrain.height_m(EAST, NORTH + 140.0))
        assert terrain.height_m(EAST, NORTH) == pytest.approx(80.0, abs=1e-4)


def test_terrain_reads_the_height_system_from_the_crs(tmp_path: Path) -> None:
    """Three-dimensional EUREF89 is ellipsoidal; NN2000 needs the geoid, and says so without it."""
    flat = write(tmp_path / "geographic.tif", "EPSG:4937", 1e-5, 600)
    assert read_terrain(flat, *DRIVE).height_m(EAST, NORTH) == pytest.approx(80.0, abs=3e-3)
    nn2000 = write(tmp_path / "nn2000.tif", "EPSG:5973", 1.0, 300)
    if np.isnan(nn2000_from_ellipsoidal([], [], []).sigma_m):
        with pytest.raises(TerrainError, match=r"are NN2000\. NN2000 heights are unknown.*HREF2018B"):
            read_terrain(nn2000, *DRIVE)
    else:
        assert read_terrain(nn2000, *DRIVE).height_m(EAST, NORTH) == pytest.approx(119.4, abs=0.1)


def test_terrain_that_cannot_be_used_says_what_and_how_to_cure_it(tmp_path: Path) -> None:
    """Each kind of bad raster gets one sentence with its name and the cure."""
    plain = write(tmp_path / "plain.tif", "EPSG:25833", 1.0, 300)
    nn54 = write(tmp_path / "nn54.tif", "EPSG:25833+5776", 1.0, 300)
    bare = tmp_path / "bare.tif"
    shift = rasterio.Affine(1.0, 0.0, EAST, 0.0, -1.0, NORTH)
    with rasterio.open(bare, "w", "GTiff", 3, 3, 1, dtype="float32", transform=shift) as file:
        file.write(np.zeros((3, 3), np.float32), 1)
    text = tmp_path / "text.tif"
    text.write_text("no raster")
    for path, heights, message in (
        (plain, None, r'plain\.tif does not say what its heights are: declare heights as "NN2000" or'),
        (nn54, None, r"nn54\.tif has heights in NN54 height: declare"),
        (plain, "amsl", 'are "amsl": use one of NN2000, ellipsoidal'),
        (bare, "ellipsoidal", r"bare\.tif has no CRS: add one"),
        (text, "ellipsoidal", r"text\.tif cannot be read .*: give a GeoTIFF"),
        (tmp_path / "none.tif", "ellipsoidal", r"none\.tif cannot be read"),
    ):
        with pytest.raises(TerrainError, match=message):
            read_terrain(path, *DRIVE, heights=heights)
    with pytest.raises(TerrainError, match="does not cover the drive"):
        read_terrain(plain, DRIVE[0] + 5000.0, DRIVE[1], heights="ellipsoidal")
    with pytest.raises(TerrainError, match="No position of the drive is known"):
        read_terrain(plain, [np.nan], [np.nan], heights="ellipsoidal")


def test_terrain_larger_than_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit is checked before anything is read."""
    monkeypatch.setattr(module, "MAX_NODES", 10_000)
    path = write(tmp_path / "dtm.tif", "EPSG:25833", 1.0, 300)
    with pytest.raises(TerrainError, match=r"nodes around the drive, more than 10,000: give a coarser one"):
        read_terrain(path, *DRIVE, heights="ellipsoidal")
