"""The road: a curved centre line, its heights and what stands beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.errors import GeolocError
from geoloc.simulation.flat_frame import LocalFrame
from geoloc.simulation.noise import gauss_markov, stream

STEP_M = 0.05
"""Grid of the integrated centre line: at a radius of 50 m the chord lies 6 µm inside the arc."""
MARGIN_M = 80.0
"""Road before station 0 and after the last station, for run-in and for signs ahead of the last frame."""
CROSSFALL_SECTION_M = 200.0
CROSSFALL_PROFILES_M = 25.0
"""From one profile to the next, where it fades: it runs straight from that of one to that of the next."""
ROUGHNESS_WAVES = 60
REFERENCE_CYCLES_PER_M = 0.1


@dataclass(frozen=True, slots=True)
class RoadSpec:
    """One two-lane road with right-hand traffic.

    The station runs along the centre line from 0 to `length_m`, the offset to the left of it.
    """

    latitude_deg: float = 63.4085
    """Where station 0 lies. Trondheim, the city of the car that is simulated."""
    longitude_deg: float = 10.4520
    height_m: float = 96.0
    """Ellipsoidal; NN2000 is 39.4 m lower there."""
    length_m: float = 500.0
    heading_deg: float = 60.0
    """True direction of the centre line at station 0."""
    curvature: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    """(station, 1/radius), left bends positive, linear in between: arcs joined by clothoids, as roads are
    designed (Statens vegvesen, håndbok N100)."""
    grade_percent: float = 1.5
    """Mean climb."""
    hills: tuple[tuple[float, float], ...] = ((150.0, 0.40), (70.0, 0.10))
    """(wavelength, amplitude) in metres: crests and sags with radii of 1.4 and 1.2 km, ordinary for
    50 km/h. With the roughness, the ground 15 m ahead then lies 0.3 degrees off the car's own plane, rms;
    0.28 to 0.92 was measured on four city drives of Argoverse 2."""
    roughness_m3: float = 64e-6
    """Displacement spectrum at 0.1 cycles/m, falling with the square of the wave number: the geometric mean
    of class B ("good") of ISO 8608."""
    lane_width_m: float = 3.25
    crossfall_percent: float = 3.0
    """The road falls to both sides of its crown: what N100 asks for on straights."""
    crossfall_spread: float = 0.3
    """One sigma of that from road to road, as a share of it: 3 ± 0.9 %. What was laid in another decade, or
    has settled and rutted since, has 1 to 5 %."""
    crossfall_wander_percent: float = 0.0
    """One sigma of what each 200 m of road, as they were laid or have settled, depart from that."""
    crossfall_lasts_m: float = 0.0
    """Not 0: that departure is no matter of sections but fades over so much road (Gauss-Markov), from profile
    to profile."""
    is_crowned: bool = True
    """False: it falls to the right all over, by `crossfall_percent`, and inwards in bends besides."""
    turns_about_m: float = 0.0
    """Where it keeps its height as its fall changes, if it has no crown."""
    climb_deg: float = 0.0
    """One sigma of a climb that fades over `climb_lasts_m`, along crests and dips of `crest_lasts_m`."""
    climb_lasts_m: float = 250.0
    crest_lasts_m: float = 2.5
    superelevation_percent: float = 0.0
    """In its sharpest bend the whole road falls this much to the inside; in proportion where it bends less.
    N100 asks for up to 8 % on open roads."""
    kerb_height_m: float = 0.12
    kerb_share: float = 0.3
    """Share of the poles that stand behind a kerb of `kerb_height_m`."""
    verge_sigma_m: float = 0.03
    """One sigma of the ground's height at a pole about the extended road surface."""
    seed: int | None = None
    """Of what was built: drives with other seeds then pass the same road. None: a road for each drive."""


class Road:
    """A road that was built from its specification and a seed."""

    def __init__(self, spec: RoadSpec, seed: int) -> None:
        self.spec = spec
        self._seed = seed if spec.seed is None else spec.seed
        self.frame = LocalFrame(spec.latitude_deg, spec.longitude_deg, spec.height_m)
        self._station = np.arange(-MARGIN_M, spec.length_m + MARGIN_M + STEP_M, STEP_M)
        start = int(np.searchsorted(self._station, -STEP_M / 2))
        knots = np.array(spec.curvature, dtype=float)
        turn = _cumulative(np.interp(self._station, knots[:, 0], knots[:, 1]), STEP_M)
        self._yaw = np.radians(90.0 - spec.heading_deg) + turn - turn[start]
        east, north = _cumulative(np.cos(self._yaw), STEP_M), _cumulative(np.sin(self._yaw), STEP_M)
        self._east, self._north = east - east[start], north - north[start]
        spread = float(stream(self._seed, "crossfall").normal()) * spec.crossfall_spread
        self._crossfall = spec.crossfall_percent * (1.0 + spread) / 100.0
        self._crossfall_wander = _crossfall_wander(spec, self._seed)
        self._sharpest_per_m = float(np.abs(knots[:, 1]).max())
        self._climb_m = _climbs(spec, self._station, self._seed)
        self._wave_per_m, self._wave_m, self._wave_phase = _roughness(spec.roughness_m3, self._seed)

    def yaw_rad(self, station_m: FloatArray) -> FloatArray:
        """Direction of the centre line, counter-clockwise from east."""
        return np.asarray(np.interp(station_m, self._station, self._yaw))

    def curvature_per_m(self, station_m: FloatArray) -> FloatArray:
        """Curvature of the centre line, left bends positive."""
        knots = np.array(self.spec.curvature, dtype=float)
        return np.asarray(np.interp(station_m, knots[:, 0], knots[:, 1]))

    def plan_m(self, station_m: FloatArray, offset_m: FloatArray) -> FloatArray:
        """East and north ``(..., 2)`` in the road's frame.

        Raises
        ------
        GeolocError
            If a station lies where the road was not built.
        """
        low, high = float(np.min(station_m, initial=0.0)), float(np.max(station_m, initial=0.0))
        if low < self._station[0] or high > self._station[-1]:
            off = low if low < self._station[0] else high
            raise GeolocError(
                f"station {off:.1f} m is not on the simulated road, which "
                f"runs from {self._station[0]:.1f} to {self._station[-1]:.1f} m: make it longer"
            )
        yaw = self.yaw_rad(station_m)
        east = np.interp(station_m, self._station, self._east) - offset_m * np.sin(yaw)
        north = np.interp(station_m, self._station, self._north) + offset_m * np.cos(yaw)
        return np.stack([east, north], axis=-1)

    def surface_m(self, station_m: FloatArray, offset_m: FloatArray) -> FloatArray:
        """Height of the surface; beyond the edge of the road it runs on level across."""
        spec = self.spec
        height = station_m * spec.grade_percent / 100.0
        for wavelength, amplitude in spec.hills:
            height = height + amplitude * np.sin(2.0 * np.pi * station_m / wavelength)
        if spec.climb_deg:
            height = height + np.interp(station_m, self._station, self._climb_m)
        phase = 2.0 * np.pi * np.multiply.outer(station_m, self._wave_per_m) + self._wave_phase
        height = height + np.sin(phase) @ self._wave_m
        return np.asarray(height + self.fall_m(station_m, offset_m))

    def fall_m(self, station_m: FloatArray, offset_m: FloatArray) -> FloatArray:
        """Height of the surface over the centre line beside it."""
        if not self.spec.is_crowned:
            return np.asarray((offset_m - self.spec.turns_about_m) * self.across_slope(station_m, offset_m))
        on_road = np.clip(offset_m, -self.spec.lane_width_m, self.spec.lane_width_m)
        return np.asarray(on_road * self.across_slope(station_m, offset_m))

    def across_slope(self, station_m: FloatArray, offset_m: FloatArray) -> FloatArray:
        """Rise to the left, metres per metre: away from the crown, or to the inside of a bend."""
        fall = self._crossfall + np.interp(station_m, *self._crossfall_wander)
        crown = -np.sign(offset_m) * fall if self.spec.is_crowned else fall
        if self.spec.superelevation_percent == 0.0 or self._sharpest_per_m == 0.0:
            return np.asarray(crown)
        bend = self.curvature_per_m(station_m) / self._sharpest_per_m
        inwards = -bend * self.spec.superelevation_percent / 100.0
        left_of_crown = 1.0 - np.abs(bend) if self.spec.is_crowned else 1.0
        return np.asarray(crown * left_of_crown + inwards)

    def pole_feet_m(self, station_m: FloatArray, offset_m: FloatArray) -> FloatArray:
        """Feet of poles ``(n, 3)``: on the verge or behind the kerb."""
        rng = stream(self._seed, "ground at the poles")
        behind_kerb = rng.random(station_m.size) < self.spec.kerb_share
        verge = rng.normal(size=station_m.size) * self.spec.verge_sigma_m
        up = self.surface_m(station_m, offset_m) + np.where(behind_kerb, self.spec.kerb_height_m, 0.0) + verge
        return np.concatenate([self.plan_m(station_m, offset_m), up[:, None]], axis=-1)


def _crossfall_wander(spec: RoadSpec, seed: int) -> tuple[FloatArray, FloatArray]:
    """Stations and what the crossfall there departs from the road's own, metres per metre."""
    if spec.crossfall_lasts_m:
        # Laid to a line between profiles: a paver turns its screed over tens of metres. Noise that fades over
        # 300 m at every point of it would tremble by 0.14 degrees within a metre.
        step_m = CROSSFALL_PROFILES_M
        station = np.arange(-MARGIN_M, spec.length_m + MARGIN_M + step_m, step_m)
        depart = gauss_markov(stream(seed, "crossfall sections"), station, 1.0, spec.crossfall_lasts_m)
        return station, depart * spec.crossfall_wander_percent / 100.0
    station = np.arange(-MARGIN_M, spec.length_m + MARGIN_M + CROSSFALL_SECTION_M, CROSSFALL_SECTION_M)
    depart = stream(seed, "crossfall sections").normal(size=station.size)
    return station, depart * spec.crossfall_wander_percent / 100.0


def _climbs(spec: RoadSpec, station_m: FloatArray, seed: int) -> FloatArray:
    """Height of a road whose climb is noise that was filtered twice: by its crests, and by its hills."""
    climb, fades = np.tan(np.radians(spec.climb_deg)), np.exp(-STEP_M / spec.climb_lasts_m)
    if climb == 0.0:
        return np.zeros(station_m.size)
    both_m = spec.climb_lasts_m + spec.crest_lasts_m
    growth_per_m = climb * np.sqrt(both_m / spec.crest_lasts_m) / spec.climb_lasts_m
    rng = stream(seed, "climbs")
    growth = gauss_markov(rng, station_m, growth_per_m, spec.crest_lasts_m)
    slope, now = np.empty(station_m.size), float(rng.normal()) * climb
    for i, more in enumerate(growth):
        slope[i] = now
        now = now * fades + more * STEP_M
    return _cumulative(slope, STEP_M)


def _cumulative(values: FloatArray, step: float) -> FloatArray:
    """Trapezoidal integral from the first sample."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * step)])


def _roughness(spectrum_m3: float, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Wave numbers, amplitudes and phases of an ISO 8608 profile with wavelengths of 0.8 to 30 m."""
    edges = np.geomspace(1.0 / 30.0, 1.0 / 0.8, ROUGHNESS_WAVES + 1)
    wave = np.sqrt(edges[1:] * edges[:-1])
    density = spectrum_m3 * (wave / REFERENCE_CYCLES_PER_M) ** -2.0
    phase = stream(seed, "roughness").uniform(0.0, 2.0 * np.pi, ROUGHNESS_WAVES)
    return wave, np.sqrt(2.0 * density * np.diff(edges)), phase
