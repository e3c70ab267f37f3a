"""Heights above sea level → ellipsoidal heights, for formats that write the former."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoloc.earth.heights import ellipsoidal_from_nn2000
from twin.drives.track.fixes import Fix


def above_ellipsoid(rows: Sequence[Fix], where: str) -> tuple[list[Fix], list[str]]:
    """Fixes whose heights are above sea level, with heights above the ellipsoid.

    Returns
    -------
    fixes : list of Fix
        As they came where the geoid model is not installed or does not cover every fix.
    warnings : list of str
        Which of the two was done; none for no fixes.
    """
    if not rows:
        return [], []
    ellipsoidal = ellipsoidal_from_nn2000(
        [row.latitude_deg for row in rows],
        [row.longitude_deg for row in rows],
        [row.height_m for row in rows],
    )
    if not np.isfinite(ellipsoidal.height_m).all():
        warning = (
            f"The heights of {where} are above sea level, and there is no geoid model here to bring them to"
            " the ellipsoid: heights of signs, and nothing else, are off by the geoid, 15 to 50 m in Norway"
            " (`twin help datum-and-heights`)."
        )
        return list(rows), [warning]
    moved = [
        row._replace(height_m=height) for row, height in zip(rows, ellipsoidal.height_m.tolist(), strict=True)
    ]
    warning = (
        f"The heights of {where} were taken as above sea level (NN2000) and brought to the ellipsoid by"
        " HREF2018B."
    )
    return moved, [warning]
