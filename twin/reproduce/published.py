"""Figures that the paper gives: Shami, Kiss, Haakonsen and Lindseth (2024), arXiv:2401.07582."""

from __future__ import annotations

from collections.abc import Mapping

STANDING_M: Mapping[str, tuple[float, ...]] = {
    "C1_front60Single": (0.77, 1.53, 5.05),
    "C2_tricam60": (0.82, 1.42, 4.53),
    "C3_tricam120": (0.34, 0.22, 1.01),
}
"""Table 1: camera (as NTNU's rig file calls it) → errors at `STANDING_AT_M`."""
STANDING_AT_M = (9.004, 11.78, 19.3)
_SAME_PLACE_M = 0.5

URBAN_M = ((6.9, 0.26), (14.6, 3.9))
"""Table 2, 13 signs in town: distance and error of the best and of the worst of them."""
MOVING_M, MOVING_WITHIN_M = 4.0, 15.0
"""On the move, up to 60 km/h: errors below the one within the other distance (figures 7 and 11)."""


def standing_m(camera: str, distance_m: float) -> float | None:
    """Error that table 1 gives of a camera at a distance; None where it has none."""
    for at_m, error_m in zip(STANDING_AT_M, STANDING_M.get(camera, ()), strict=False):
        if abs(at_m - distance_m) < _SAME_PLACE_M:
            return error_m
    return None
