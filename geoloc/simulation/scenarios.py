"""Ready-made worlds: where the road runs, how the car drives and where the poles stand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from geoloc.errors import GeolocError
from geoloc.simulation.beside import GroundBeside
from geoloc.simulation.long_roads import LONG_ROADS, RoadCharacter, long_road
from geoloc.simulation.motion import MotionSpec
from geoloc.simulation.noise import NoiseSpec, stream
from geoloc.simulation.road import RoadSpec

START_UTC_NS = int(datetime(2026, 6, 10, 8, 0, tzinfo=UTC).timestamp()) * 1_000_000_000
"""First frame of every simulated drive: 2026-06-10 08:00:00 UTC."""
ALL_CAMERAS = ("C1_front60Single", "C2_tricam60", "C3_tricam120")
MAX_SPEED_KMH = 130.0
CODES = ("362.50", "516", "512", "372", "202", "142", "366", "404.1", "906H", "108;808.105", "142;802")
REAR_AXLE_TO_CAMERA_M = 1.8


@dataclass(frozen=True, slots=True)
class PoleSpec:
    """One pole: its object id, its sign codes top down, and where it stands along and across the road."""

    object: str
    skiltnummer: str
    station_m: float
    offset_m: float


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything that `simulate_drive` needs but the seed.

    Attributes
    ----------
    name : str
    road, motion, noise : RoadSpec, MotionSpec, NoiseSpec
    poles : tuple of PoleSpec
    cameras : tuple of str
        The cameras whose frames were annotated.
    annotate_every : int
        Every n-th frame carries annotations: 3 is 10 Hz, as annotators set key frames.
    annotate_from_s : float
        Frames before carry none: seconds since the first frame.
    range_m : (float, float)
        Horizontal distance from the camera within which a foot is annotated: nearer it is below the image,
        farther an annotator no longer sees where the pole meets the ground.
    start_utc_ns : int
    beside : GroundBeside or None
        Ground below the feet that departs from the car's plane; None: the road's surface, verges and kerbs.
    """

    name: str
    road: RoadSpec
    motion: MotionSpec
    poles: tuple[PoleSpec, ...]
    noise: NoiseSpec = field(default_factory=NoiseSpec)
    cameras: tuple[str, ...] = ALL_CAMERAS
    annotate_every: int = 3
    annotate_from_s: float = 0.0
    range_m: tuple[float, float] = (5.0, 40.0)
    start_utc_ns: int = START_UTC_NS
    beside: GroundBeside | None = None


def scenario(
    name: str, speed_kmh: float | None = None, seed: int = 0, minutes: float | None = None
) -> Scenario:
    """Return one of the ready-made worlds.

    Parameters
    ----------
    name : str
        ``sample`` (the drive in ``data/``), ``still`` (drives up to a flat yard and stands: objects at 9.0,
        11.8 and 19.3 m as in the paper), ``approach`` (one object, 15 to 6 m), ``urban`` (13 poles) or
        ``highway`` (16 poles).
    speed_kmh : float, optional
        Default: the scenario's own (sample 40, approach 15, urban 25, highway 60). Ignored for ``still``.
    seed : int
        Places the poles of ``urban`` and ``highway``; the others are fixed.
    minutes : float, optional
        ``urban`` and ``highway`` only: so long a drive on a road that does not repeat, whose bends, hills and
        crossfall follow from the seed (`geoloc.simulation.long_roads`).

    Raises
    ------
    GeolocError
        If there is no such scenario, the speed is not between 1 and 130 km/h, or it has a length of its own.
    """
    if name not in SCENARIOS:
        raise GeolocError(f"there is no scenario {name!r}: choose one of {', '.join(SCENARIOS)}")
    build, own_speed = SCENARIOS[name]
    speed = own_speed if speed_kmh is None else speed_kmh
    if not 1.0 <= speed <= MAX_SPEED_KMH:
        raise GeolocError(f"a simulated car drives 1 to {MAX_SPEED_KMH:.0f} km/h, not {speed:g}")
    if minutes is None:
        return build(speed / 3.6, seed)
    if name not in LONG_ROADS:
        raise GeolocError(
            f"scenario {name!r} has a length of its own: minutes go with {', '.join(LONG_ROADS)}"
        )
    return _long_drive(build(speed / 3.6, seed), LONG_ROADS[name], speed / 3.6, 60.0 * minutes, seed)


def _long_drive(
    short: Scenario, character: RoadCharacter, speed_mps: float, duration_s: float, seed: int
) -> Scenario:
    """Drive on a longer road of the same kind, with as many poles a metre."""
    length_m = duration_s * speed_mps + 40.0
    road = long_road(short.road, character, length_m, seed)
    offsets = (4.3, 6.5) if short.name == "urban" else (5.2, 7.5)
    count = round(length_m * len(short.poles) / short.road.length_m)
    poles = _scattered(count, 35.0, length_m - 40.0, offsets, seed)
    motion = replace(short.motion, duration_s=round(duration_s, 1))
    return replace(short, road=road, motion=motion, poles=poles)


def _sample(speed_mps: float, _seed: int) -> Scenario:
    """480 m with a left and a right bend, and half the speed in between."""
    bend, counterbend = 1.0 / 160.0, -1.0 / 200.0
    curvature = (
        (60.0, 0.0),
        (100.0, bend),
        (160.0, bend),
        (200.0, 0.0),
        (270.0, 0.0),
        (310.0, counterbend),
        (370.0, counterbend),
        (410.0, 0.0),
    )
    # Spelt out, so that the shipped bytes stay whatever other drives are made of.
    road = RoadSpec(length_m=500.0, curvature=curvature, crossfall_percent=2.0, crossfall_spread=0.0)
    noise = NoiseSpec(
        gnss_slow_horizontal_m=0.008,
        gnss_slow_vertical_m=0.017,
        rig_origin_m=0.0,
        slip_sigma_deg_per_mps2=0.0,
    )
    slow = speed_mps / 2.0
    fast_s, change_s, slow_s = 178.0 / speed_mps, 33.0 / (0.75 * speed_mps), 33.0 / slow
    time = [0.0, fast_s, fast_s + change_s, fast_s + change_s + slow_s, fast_s + 2.0 * change_s + slow_s]
    motion = MotionSpec(
        duration_s=round(time[-1] + 200.0 / speed_mps, 1),
        speed=tuple(zip(time, (speed_mps, speed_mps, slow, slow, speed_mps), strict=True)),
    )
    return Scenario("sample", road, motion, SAMPLE_POLES, noise, cameras=("C2_tricam60", "C3_tricam120"))


def _still(_speed_mps: float, _seed: int) -> Scenario:
    """Drive 57 m across a yard at 20 km/h, stop smoothly, and stand for 4 s; annotated only then.

    What a road lab does: nobody appears out of nowhere, and a car that stands knows its heading from having
    driven there. The yard is paved flat (no hills, no kerbs, a crossfall for the rain, a surface of class A)
    since the paper's own rule of the ground is a flat floor. Distances are from the rig's origin where the
    car stands.
    """
    speed_mps, cruise_s, brake_s, rest_s, stand_s = 20.0 / 3.6, 7.2, 6.0, 0.5, 4.0
    stop_m = speed_mps * (cruise_s + brake_s / 2.0)
    stopped_s = cruise_s + brake_s
    motion = MotionSpec(
        duration_s=stopped_s + rest_s + stand_s,
        speed=((cruise_s, speed_mps), (stopped_s, 0.0)),
        wander_m=0.0,
    )
    yard = RoadSpec(
        length_m=stop_m + 40.0,
        grade_percent=0.0,
        hills=(),
        roughness_m3=16e-6,
        crossfall_percent=0.3,
        kerb_share=0.0,
        verge_sigma_m=0.01,
    )
    places = ((9.0, -14.0), (11.8, 12.0), (19.3, -9.0))
    poles = tuple(
        PoleSpec(
            f"P{i:02d}",
            "362.50",
            stop_m + distance * math.cos(math.radians(bearing)),
            motion.lane_offset_m + distance * math.sin(math.radians(bearing)),
        )
        for i, (distance, bearing) in enumerate(places, start=1)
    )
    return Scenario("still", yard, motion, poles, annotate_from_s=stopped_s + rest_s)


def _approach(speed_mps: float, _seed: int) -> Scenario:
    """Drive towards one pole; it is annotated from 15 to 6 m."""
    pole = PoleSpec("P01", "362.50", 60.0, -4.6)
    motion = MotionSpec(
        duration_s=round((pole.station_m - REAR_AXLE_TO_CAMERA_M - 5.0) / speed_mps, 1),
        speed=((0.0, speed_mps),),
    )
    return Scenario("approach", RoadSpec(length_m=80.0), motion, (pole,), range_m=(6.0, 15.0))


def _urban(speed_mps: float, seed: int) -> Scenario:
    """13 poles on 300 m of street with two bends."""
    curvature = (
        (50.0, 0.0),
        (75.0, 1 / 60.0),
        (105.0, 1 / 60.0),
        (130.0, 0.0),
        (170.0, 0.0),
        (200.0, -1 / 80.0),
        (230.0, -1 / 80.0),
        (260.0, 0.0),
    )
    road = RoadSpec(length_m=320.0, curvature=curvature, kerb_share=0.5)
    poles = _scattered(13, 35.0, 285.0, (4.3, 6.5), seed)
    motion = MotionSpec(duration_s=round(300.0 / speed_mps, 1), speed=((0.0, speed_mps),))
    return Scenario("urban", road, motion, poles)


def _highway(speed_mps: float, seed: int) -> Scenario:
    """16 poles on 700 m of open road with wide bends."""
    curvature = (
        (120.0, 0.0),
        (200.0, 1 / 450.0),
        (320.0, 1 / 450.0),
        (400.0, 0.0),
        (450.0, 0.0),
        (530.0, -1 / 500.0),
        (640.0, -1 / 500.0),
        (720.0, 0.0),
    )
    road = RoadSpec(
        length_m=720.0,
        curvature=curvature,
        lane_width_m=3.5,
        superelevation_percent=6.0,
        kerb_share=0.0,
        verge_sigma_m=0.06,
    )
    poles = _scattered(16, 45.0, 675.0, (5.2, 7.5), seed)
    motion = MotionSpec(
        duration_s=round(700.0 / speed_mps, 1), speed=((0.0, speed_mps),), lane_offset_m=-1.75
    )
    return Scenario("highway", road, motion, poles)


def _scattered(
    count: int, first_m: float, last_m: float, offset_m: tuple[float, float], seed: int
) -> tuple[PoleSpec, ...]:
    """Poles at random places, three of four on the right."""
    rng = stream(seed, "poles")
    spacing = (last_m - first_m) / count
    poles = []
    for i in range(count):
        station = first_m + spacing * (i + rng.uniform(0.1, 0.9))
        side = -1.0 if rng.random() < 0.75 else 1.0
        code = CODES[int(rng.integers(len(CODES)))]
        poles.append(PoleSpec(f"P{i + 1:02d}", code, station, side * rng.uniform(*offset_m)))
    return tuple(poles)


SAMPLE_POLES = (
    PoleSpec("P01", "362.50", 38.0, -5.0),
    PoleSpec("P02", "516", 80.0, -5.2),
    PoleSpec("P03", "516", 82.0, 5.2),
    PoleSpec("P04", "142;802", 118.0, -5.6),
    PoleSpec("P05", "512", 149.0, -5.0),
    PoleSpec("P06", "366;372;808.105", 178.0, -5.8),
    PoleSpec("P07", "372", 203.0, -5.1),
    PoleSpec("P08", "906H", 232.0, -4.7),
    PoleSpec("P09", "202", 262.0, -6.0),
    PoleSpec("P10", "108;808.105", 292.0, -5.3),
    PoleSpec("P11", "512", 322.0, 5.6),
    PoleSpec("P12", "362.50", 352.0, -5.2),
    PoleSpec("P13", "404.1;906V", 388.0, -4.8),
    PoleSpec("P14", "406", 420.0, -5.5),
    PoleSpec("P15", "522", 448.0, -5.2),
)
"""The poles of the sample: 15 poles with 20 plates."""

SCENARIOS: dict[str, tuple[Callable[[float, int], Scenario], float]] = {
    "sample": (_sample, 40.0),
    "still": (_still, 1.0),
    "approach": (_approach, 15.0),
    "urban": (_urban, 25.0),
    "highway": (_highway, 60.0),
}


def without_noise(world: Scenario) -> Scenario:
    """Return the same world without errors of sensors, body or annotator; the road keeps its shape."""
    return replace(world, noise=NoiseSpec.none())
