"""Roads as long as one likes, none of whose stretches repeats another."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from geoloc.simulation.noise import stream
from geoloc.simulation.road import RoadSpec

_FIRST_BEND_M = 60.0
# A road that comes back towards its beginning stays where one plane is level: 3 km from its middle the plumb
# line is 0.03 degrees off.
_WITHIN_M = 3000.0
# Of each range of wavelengths: fewer would bring the same hills again.
_WAVES = 5


@dataclass(frozen=True, slots=True)
class RoadCharacter:
    """What bends and hills a kind of road has: ranges of a uniform draw.

    Attributes
    ----------
    straight_m, radius_m, turn_deg : (float, float)
        Straights between bends; radius of a bend and how far it turns the road.
    clothoid_m : float
        Length of each of a bend's two transition curves.
    hills : tuple of (float, float)
        (wavelength, rms climb in percent) about which waves are drawn.
    """

    straight_m: tuple[float, float]
    radius_m: tuple[float, float]
    turn_deg: tuple[float, float]
    clothoid_m: float
    hills: tuple[tuple[float, float], ...]


# Climbs of ten real roads change by 1.5 degrees, rms, over 60 m; and by about 4 % from hill to hill.
_HILLS = ((60.0, 0.7), (130.0, 1.0), (250.0, 1.5), (500.0, 1.5), (1100.0, 1.5))
LONG_ROADS = {
    "urban": RoadCharacter((30.0, 150.0), (60.0, 200.0), (20.0, 80.0), 25.0, _HILLS),
    "highway": RoadCharacter((60.0, 300.0), (350.0, 900.0), (10.0, 50.0), 80.0, _HILLS),
}
"""By the scenario whose lanes, verges and kerbs they have."""


def long_road(like: RoadSpec, character: RoadCharacter, length_m: float, seed: int) -> RoadSpec:
    """Draw bends and hills for a road of this length, with the lanes and verges of `like`."""
    rng = stream(seed, "long road")
    hills: list[tuple[float, float]] = []
    for wavelength_m, climb_percent in character.hills:
        steepest = math.sqrt(2.0 / _WAVES) * climb_percent / 100.0
        drawn_m = (wavelength_m * rng.uniform(0.7, 1.4, _WAVES)).tolist()
        hills += [(one_m, steepest * one_m / (2.0 * math.pi)) for one_m in drawn_m]
    return replace(
        like,
        length_m=length_m,
        curvature=_bends(character, length_m, math.radians(90.0 - like.heading_deg), rng),
        grade_percent=0.0,
        hills=tuple(hills),
        crossfall_wander_percent=0.5,
    )


def _bends(
    character: RoadCharacter, length_m: float, yaw_rad: float, rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    """Knots (station, curvature) of straights and bends that keep the road about its beginning."""
    knots, station_m, east_m, north_m = [(0.0, 0.0)], 0.0, 0.0, 0.0
    straight_m = _FIRST_BEND_M
    while station_m < length_m:
        radius_m, turn_rad = rng.uniform(*character.radius_m), np.radians(rng.uniform(*character.turn_deg))
        arc_m = max(turn_rad * radius_m - character.clothoid_m, 0.0)
        side = 1.0 if rng.random() < 0.5 else -1.0
        if math.hypot(east_m, north_m) > _WITHIN_M:
            to_middle = math.atan2(-north_m, -east_m) - yaw_rad
            side = math.copysign(1.0, math.sin(to_middle))
        begins_m = station_m + straight_m
        ends = np.cumsum([begins_m, character.clothoid_m, arc_m, character.clothoid_m])
        knots += zip(ends.tolist(), (0.0, side / radius_m, side / radius_m, 0.0), strict=True)
        bend_m, turned = 2.0 * character.clothoid_m + arc_m, (character.clothoid_m + arc_m) / radius_m
        for way_m, turn in ((straight_m, 0.0), (bend_m, side * turned)):
            yaw_rad += 0.5 * turn
            east_m, north_m = east_m + way_m * math.cos(yaw_rad), north_m + way_m * math.sin(yaw_rad)
            yaw_rad += 0.5 * turn
        station_m = float(ends[-1])
        straight_m = rng.uniform(*character.straight_m)
    return tuple(knots)
