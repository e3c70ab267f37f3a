"""A trajectory as a GeoPackage: where the car was, and how well that is known."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geoloc.earth.geodesy import utm33_from_geographic
from geoloc.trajectory.poses import Poses
from geoloc.trajectory.trajectory import MAX_GAP_S
from twin.errors import ExportRefusedError
from twin.export.layers import EPSG_UTM33
from twin.store.atomic_files import replacing

if TYPE_CHECKING:
    import geopandas as gpd

_MEASURES = ("height_m", "roll_deg", "pitch_deg", "heading_deg", "speed_mps")
_SIGMAS = (
    *("sigma_horizontal_m", "sigma_vertical_m"),
    *("sigma_roll_deg", "sigma_pitch_deg", "sigma_heading_deg"),
)


def write_poses_geopackage(poses: Poses, path: Path) -> None:
    """Write valid poses in EPSG:25833, heights ellipsoidal.

    The layer ``poses`` has a point a pose. ``path`` has a line from each pose to the next, with the larger
    sigma of its two ends, to colour the way by; none over a gap.

    Raises
    ------
    ExportRefusedError
        The file cannot be written, or is open in QGIS: what was there is as it was.
    """
    from pyogrio.errors import DataLayerError, DataSourceError

    try:
        with replacing(path.parent, (path.name,)) as staging:
            for name, frame in _layers(poses).items():
                frame.to_file(staging / path.name, layer=name, driver="GPKG", engine="pyogrio")
    except (OSError, DataSourceError, DataLayerError) as error:
        why = getattr(error, "strerror", None) or "the GeoPackage could not be written in full"
        raise ExportRefusedError(
            f"cannot write {path} ({why}): free space on the disk or name a file that can be written"
        ) from error


def _layers(poses: Poses) -> dict[str, gpd.GeoDataFrame]:
    import geopandas as gpd
    import pandas as pd
    import shapely

    east, north = utm33_from_geographic(poses.latitude_deg, poses.longitude_deg)
    at = np.column_stack([east, north, poses.height_m])
    time = {
        "time_ns": poses.epoch_ns,
        "time": pd.to_datetime(poses.epoch_ns, unit="ns", utc=True).round("ms").as_unit("ms").to_numpy(),
    }
    columns = {name: getattr(poses, name) for name in (*_MEASURES, *_SIGMAS)}
    points = gpd.GeoDataFrame({**time, **columns}, geometry=shapely.points(at), crs=EPSG_UTM33)
    near = np.flatnonzero(np.diff(poses.epoch_ns) <= MAX_GAP_S * 1e9)
    sigmas = {name: np.maximum(columns[name][near], columns[name][near + 1]) for name in _SIGMAS}
    lines = gpd.GeoDataFrame(
        {**{name: values[near] for name, values in time.items()}, **sigmas},
        geometry=shapely.linestrings(np.stack([at[near], at[near + 1]], axis=1)),
        crs=EPSG_UTM33,
    )
    return {"poses": points, "path": lines}
