"""Edges of a black square on white, as points to some hundredths of a pixel."""

from __future__ import annotations

import numpy as np

from geoloc.arrays import ByteArray, FloatArray

CELLS = 8
"""Cells across the black square of a 36h11 tag; markers of boards have about as many."""
LEAST_SIDE_PX = 20.0
"""Smaller squares have no edges to speak of."""
LEAST_POINTS = 6
_ENDS = 0.12
"""Part of an edge at either end that the neighbouring edge's blur reaches."""
_REACH_CELLS = 0.4
_LEAST_REACH_PX, _MOST_REACH_PX = 1.5, 5.0
_STEPS = 33
_LEAST_CONTRAST = 8.0
_WIDTH_REACH_CELLS, _MOST_WIDTH_REACH_PX = 0.9, 12.0
_GAUSS_WIDTH = float(2.0 * np.sqrt(2.0 * np.log(2.0)) / np.sqrt(2.0 * np.pi))
"""Half-height width of a Gaussian times the greatest slope of the step that it blurs."""
_ROUNDS = 2
_LEAST_ANGLE = 0.1


def edge_points(grey: ByteArray, start_px: FloatArray, end_px: FloatArray) -> FloatArray | None:
    """Sub-pixel points (n, 2) along one edge: the centroid of the grey step across it."""
    import cv2

    along = end_px - start_px
    length = float(np.linalg.norm(along))
    if length < LEAST_SIDE_PX:
        return None
    along /= length
    # Corners run clockwise in the picture, so this points out of the black square.
    outward = np.array([along[1], -along[0]])
    reach = float(np.clip(_REACH_CELLS * length / CELLS, _LEAST_REACH_PX, _MOST_REACH_PX))
    place = np.linspace(_ENDS, 1.0 - _ENDS, max(int(length), LEAST_POINTS)) * length
    across = np.linspace(-reach, reach, _STEPS)
    u, v = (
        (start_px[axis] + place[:, np.newaxis] * along[axis] + across * outward[axis]).astype(np.float32)
        for axis in (0, 1)
    )
    profile = cv2.remap(grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    step = np.maximum(np.diff(profile, axis=1), 0.0)
    total = step.sum(axis=1)
    strong = total > max(_LEAST_CONTRAST, 0.5 * float(np.median(total)))
    if strong.sum() < LEAST_POINTS:
        return None
    middle = 0.5 * (across[1:] + across[:-1])
    offset = (step[strong] * middle).sum(axis=1) / total[strong]
    points = start_px + place[strong, np.newaxis] * along + offset[:, np.newaxis] * outward
    return np.asarray(points, dtype=np.float64)


def edge_width_px(grey: ByteArray, corners_px: FloatArray) -> float:
    """Width of a square's edges in the picture, of a Gaussian's half height: how blurred it is there.

    The print is of one colour for a cell to either side, so that a profile across an edge, averaged along it,
    rises as the blur has it. The direction that is blurred most counts. NaN where no edge is seen.
    """
    import cv2

    widths = []
    for side in range(4):
        start, end = corners_px[side], corners_px[(side + 1) % 4]
        length = float(np.linalg.norm(end - start))
        along = (end - start) / max(length, 1e-9)
        place = np.linspace(_ENDS, 1.0 - _ENDS, max(int(length), LEAST_POINTS)) * length
        reach = min(_WIDTH_REACH_CELLS * length / CELLS, _MOST_WIDTH_REACH_PX)
        across = np.linspace(-reach, reach, _STEPS)
        u, v = (
            (start[axis] + place[:, np.newaxis] * along[axis] + across * outward).astype(np.float32)
            for axis, outward in enumerate((along[1], -along[0]))
        )
        profile = cv2.remap(grey.astype(np.float32), u, v, cv2.INTER_LINEAR).mean(axis=0)
        slope = float(np.gradient(profile, across).max())
        rise = float(np.ptp(profile))
        if rise < _LEAST_CONTRAST or slope <= 0.0:
            return float("nan")
        widths.append(_GAUSS_WIDTH * rise / slope)
    return max(0.5 * (widths[0] + widths[2]), 0.5 * (widths[1] + widths[3]))


def by_edges(grey: ByteArray, rough_px: FloatArray) -> FloatArray | None:
    """Corners (4, 2) where straight lines along the edges cross; None where an edge cannot be made out.

    For squares so small that a lens bends none of their edges.
    """
    corners = rough_px
    for _ in range(_ROUNDS):
        lines = []
        for side in range(4):
            points = edge_points(grey, corners[side], corners[(side + 1) % 4])
            if points is None:
                return None
            middle = points.mean(axis=0)
            lines.append((middle, np.linalg.svd(points - middle)[2][1]))
        crossing = []
        for (before, across), (after, other) in zip([lines[-1], *lines[:-1]], lines, strict=True):
            normals = np.stack([across, other])
            if abs(np.linalg.det(normals)) < _LEAST_ANGLE:
                return None
            crossing.append(np.linalg.solve(normals, [across @ before, other @ after]))
        corners = np.array(crossing)
    return corners
