"""Corners of a board in a picture, to a few hundredths of a pixel, and how sharp the picture is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import ByteArray, FloatArray, IntArray
from geoloc.calibration.extrinsics.tag_family import is_apriltag
from geoloc.calibration.intrinsics import MIN_CORNERS, View
from twin.calibrate.boards.boards import Board
from twin.calibrate.boards.edges import by_edges
from twin.calibrate.boards.saddle import refined

BLURRED_PX = 5.0
"""Width of edges at which corners lose their sub-pixels."""
_PROFILE_SAMPLES = 33
_NO_MARKER = (float("nan"), float("nan"))
_Found = tuple[IntArray, FloatArray, tuple[float, float]]
_GAUSS_WIDTH = 2.0 * np.sqrt(2.0 * np.log(2.0))


@dataclass(frozen=True, slots=True)
class DetectedBoard:
    """The board in one picture.

    Attributes
    ----------
    view : View
    ids : int64 (n,)
        Numbers of its corners on the board.
    edge_px : float
        Width of the print's edges in the picture (of a Gaussian's half height): how blurred it is.
    marker_part, marker_px : float
        Side of the markers as part of a square's, as seen, and in pixels; NaN without markers.
    """

    view: View
    ids: IntArray
    edge_px: float
    marker_part: float
    marker_px: float


def detect(image: ByteArray, board: Board, name: str) -> DetectedBoard | None:
    """Find the board in a grey picture; None if it is not there, or too little of it.

    Coarse corners come from OpenCV's detectors; each is then fitted to the grey values around it (`saddle`).
    What is no corner in those is left out.
    """
    find = _checkerboard if board.kind == "checkerboard" else _charuco
    found, scale = find(image, board), 1
    if found is None:
        # Blurred markers and corners are found in a picture half the size: then their blur can be told.
        found, scale = find(_halved(image), board), 2
    if found is None:
        return None
    ids, pixel, marker = found
    pixel = scale * (pixel + 0.5) - 0.5
    grid = np.column_stack([ids % board.columns, ids // board.columns]).astype(np.float64)
    pixel, good = refined(image, grid, pixel, board.clear_part)
    ids, pixel = ids[good], pixel[good]
    if len(ids) < MIN_CORNERS or np.ptp(grid[good], axis=0).min() < 1.0:
        return None
    view = View(name, board.corners_m(ids), pixel)
    return DetectedBoard(view, ids, edge_width_px(image, board, ids, pixel), *marker)


def _halved(image: ByteArray) -> ByteArray:
    import cv2

    height, width = (n // 2 for n in image.shape)
    return np.asarray(
        cv2.resize(image[: 2 * height, : 2 * width], (width, height), interpolation=cv2.INTER_AREA)
    )


def _checkerboard(image: ByteArray, board: Board) -> _Found | None:
    import cv2

    size = (board.columns, board.rows)
    found, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return None
    grid = np.asarray(corners, dtype=np.float64).reshape(board.rows, board.columns, 2)
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if across[0] * down[1] - across[1] * down[0] < 0.0:
        # Counted from the other side: as in a mirror. The print itself looks the same both ways.
        grid = grid[:, ::-1]
    return np.arange(board.n_corners), grid.reshape(-1, 2), _NO_MARKER


def _charuco(image: ByteArray, board: Board) -> _Found | None:
    import cv2

    # Boards that OpenCV made have AprilTags upside down; with those of the other way not a corner is found.
    for turns in (0, 2) if is_apriltag(board.dictionary) else (0,):
        corners, ids, markers, _ = cv2.aruco.CharucoDetector(board.aruco(turns)).detectBoard(image)
        if ids is not None and len(ids) >= MIN_CORNERS:
            break
    else:
        return None
    numbers, pixel = ids.ravel().astype(np.int64), np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    sides = np.array([_by_edges(image, np.asarray(m, dtype=np.float64).reshape(4, 2)) for m in markers])
    return numbers, pixel, _marker(board, numbers, pixel, sides.reshape(-1, 4, 2))


def _by_edges(image: ByteArray, contour: FloatArray) -> FloatArray:
    """Corners (4, 2) of a marker by its edges; of a small one by its contour."""
    found = by_edges(image, contour)
    if found is not None:
        return found
    # Contours run through the middles of a marker's outermost pixels: half a pixel inside, all around.
    side, middle = np.sqrt(max(float(_area(contour[np.newaxis])[0]), 1.0)), contour.mean(axis=0)
    return np.asarray(middle + (contour - middle) * (1.0 + 1.0 / side))


def _marker(board: Board, ids: IntArray, pixel: FloatArray, markers: FloatArray) -> tuple[float, float]:
    """Side of the markers as part of a square's, and in pixels: by areas, where squares are seen whole."""
    known = np.full((board.n_corners, 2), np.nan)
    known[ids] = pixel
    grid = known.reshape(board.rows, board.columns, 2)
    squares = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2).reshape(-1, 4, 2)
    squares = squares[np.isfinite(squares).all(axis=(1, 2))]
    if not len(squares) or not len(markers):
        return _NO_MARKER
    side = np.sqrt(_area(markers))
    apart = np.linalg.norm(squares.mean(axis=1)[:, None] - markers.mean(axis=1), axis=-1)
    nearest = apart.argmin(axis=1)
    area = _area(squares)
    mine = apart.min(axis=1) < 0.1 * np.sqrt(area)
    parts = (side[nearest] / np.sqrt(area))[mine]
    return (float(np.median(parts)), float(np.median(side[nearest][mine]))) if parts.size else _NO_MARKER


def _area(quadrangle: FloatArray) -> FloatArray:
    """Areas (n,) of quadrangles (n, 4, 2)."""
    first, second = quadrangle[:, 2] - quadrangle[:, 0], quadrangle[:, 3] - quadrangle[:, 1]
    return np.asarray(0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]))


def _neighbours(board: Board, ids: IntArray) -> tuple[IntArray, IntArray]:
    """Index pairs (two of (m,)) into `ids` of corners that are neighbours in a row or a column."""
    place = np.full(board.n_corners, -1)
    place[ids] = np.arange(len(ids))
    grid = place.reshape(board.rows, board.columns)
    first = np.concatenate([grid[:, :-1].ravel(), grid[:-1].ravel()])
    second = np.concatenate([grid[:, 1:].ravel(), grid[1:].ravel()])
    both = (first >= 0) & (second >= 0)
    return first[both], second[both]


def edge_width_px(image: ByteArray, board: Board, ids: IntArray, pixel: FloatArray) -> float:
    """Width of the printed edges in the picture: the lens's and the motion's blur.

    Between two neighbouring corners the print changes colour along a straight edge. A profile across its
    middle has a slope; height over slope is the width of the Gaussian that blurs a step, here at its half
    height. The median over all edges; the direction that is blurred most counts. NaN without edges.
    """
    from scipy.ndimage import map_coordinates

    first, second = _neighbours(board, ids)
    if not first.size:
        return float("nan")
    edge = pixel[second] - pixel[first]
    length = np.linalg.norm(edge, axis=1, keepdims=True)
    normal = np.column_stack([-edge[:, 1], edge[:, 0]]) / length
    reach = np.minimum(0.8 * board.clear_part * length, 12.0)
    step = np.linspace(-1.0, 1.0, _PROFILE_SAMPLES)
    middle = 0.5 * (pixel[first] + pixel[second])
    place = middle[:, np.newaxis] + (reach * step)[:, :, np.newaxis] * normal[:, np.newaxis]
    profile = map_coordinates(
        image.astype(np.float64), [place[..., 1], place[..., 0]], order=1, mode="nearest"
    )
    rise = np.ptp(profile, axis=1)
    slope = np.abs(np.gradient(profile, axis=1)).max(axis=1) / (2.0 * reach[:, 0] / (_PROFILE_SAMPLES - 1))
    width = rise / np.maximum(slope, 1e-9) * _GAUSS_WIDTH / np.sqrt(2.0 * np.pi)
    across = np.abs(normal[:, 0]) > np.abs(normal[:, 1])
    medians = [np.median(width[part]) for part in (across, ~across) if part.any()]
    return float(max(medians))
