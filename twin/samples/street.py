"""What stands beside the sample's road: poles with their faces, parked cars, people, houses and trees.

All of it is invented; number plates are letters and digits by lot.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.simulation.pictures.scene import Kind, Patch, Rgb, Thing
from geoloc.simulation.road import Road
from geoloc.simulation.simulate import SimulatedDrive
from twin.drawings import Face, face, painted
from twin.drawings.shapes import Disc, Line, Polygon, Shape, Text, rectangle, shrunk
from twin.samples.sample_nvdb import TEXTS

POLE_RADIUS_M, PLATE_GAP_M = 0.03, 0.03
LOWEST_M, LOWEST_MARKER_M = 2.2, 0.35
"""Height of the lowest plate's lower edge; obstacle markers stand low."""
CARS: tuple[tuple[float, float, float], ...] = (
    (44.0, -9.8, 1.0),
    (62.0, 7.9, -1.0),
    (97.0, -9.6, 1.0),
    (124.0, -9.6, -1.0),
    (131.0, 8.0, -1.0),
    (155.0, -9.9, 1.0),
    (187.0, -9.8, 1.0),
    (212.0, -9.5, 1.0),
    (236.5, -7.6, 1.0),
    (268.0, -9.8, -1.0),
    (299.0, -9.6, 1.0),
    (315.0, -9.6, 1.0),
    (329.0, 8.4, -1.0),
    (359.0, -9.6, 1.0),
    (377.0, 8.0, -1.0),
    (394.0, -8.6, 1.0),
    (427.0, -9.9, 1.0),
    (455.0, -9.4, -1.0),
)
"""Station and offset of parked cars, and whether they look along the road or against it."""
PEOPLE: tuple[tuple[float, float, float], ...] = (
    (34.0, -7.4, 0.35),
    (83.5, -6.5, 0.0),
    (86.0, 6.4, 0.0),
    (112.0, -7.2, 0.3),
    (119.2, -6.7, 0.0),
    (152.0, -6.3, 0.0),
    (153.0, -6.9, 0.0),
    (181.0, -7.5, -0.2),
    (205.0, -6.4, 0.0),
    (233.4, -5.5, 0.0),
    (264.0, -7.1, 0.0),
    (294.0, -6.5, 0.1),
    (307.5, -6.4, 0.0),
    (324.0, 6.6, 0.0),
    (325.0, 7.2, 0.0),
    (354.0, -6.3, 0.0),
    (386.0, -7.4, 0.15),
    (422.0, -6.9, 0.0),
    (449.5, -6.6, 0.0),
)
"""Station and offset of people, and how fast they walk along the road, m/s."""
_PAINTS: tuple[Rgb, ...] = (
    (178, 34, 40),
    (44, 78, 130),
    (225, 226, 222),
    (58, 62, 66),
    (40, 92, 74),
    (150, 155, 160),
)
_JACKETS = ("#b03a2e", "#1f618d", "#d4ac0d", "#2e4053", "#6c3483", "#117a65")
_SKIN, _HAIR = ("#e0ac86", "#8d5a3a"), ("#3b2a1e", "#c9a66b", "#1c1c1c")
_TROUSERS = ("#2c3e50", "#4a4a4a", "#5d6d3a")
_TORSO = ((28.0, 56.0), (40.0, 46.0), (62.0, 46.0), (74.0, 56.0), (71.0, 160.0), (32.0, 160.0))
_GLASS: Rgb = (40, 52, 60)
_HOUSES: tuple[Rgb, ...] = ((152, 44, 36), (236, 232, 220), (214, 178, 92), (120, 134, 128))


@dataclass(frozen=True, slots=True)
class Spot:
    """A place beside the road and its axes: along the road, to its left, up."""

    origin_m: FloatArray
    axes: FloatArray

    def world(self, local_m: FloatArray) -> FloatArray:
        """Points ``(n, 3)`` of this place's own axes in the road's frame."""
        return np.asarray(self.origin_m + local_m @ self.axes)


def spot(road: Road, station_m: float, offset_m: float) -> Spot:
    """Return a place on the ground beside the road."""
    station, offset = np.array([station_m]), np.array([offset_m])
    origin = np.append(road.plan_m(station, offset)[0], road.surface_m(station, offset)[0])
    return Spot(origin, _axes(float(road.yaw_rad(station)[0])))


def street(drive: SimulatedDrive, road: Road, rng: np.random.Generator) -> list[Thing]:
    """Build everything that stands beside the road of a drive."""
    things = [*_poles(drive, road), *_houses(road, rng), *_trees(road, rng)]
    for i, (station, offset, facing) in enumerate(CARS):
        here = spot(road, station, offset)
        turned = Spot(here.origin_m, here.axes * np.array([[facing], [facing], [1.0]]))
        things.append(Thing(here.origin_m, tuple(_car(turned, _PAINTS[i % len(_PAINTS)], _number(rng)))))
    for i, (station, offset, speed) in enumerate(PEOPLE):
        here = spot(road, station, offset)
        cut_out = _person(i, rng)
        patches = tuple(_plane(cut_out, here, 0.0, 0.0, Kind.PERSON))
        things.append(Thing(here.origin_m, patches, here.axes[0] * speed))
    return things


def _axes(yaw_rad: float) -> FloatArray:
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def _poles(drive: SimulatedDrive, road: Road) -> Iterator[Thing]:
    for spec, foot in zip(drive.scenario.poles, drive.objects.enu_m, strict=True):
        here = Spot(foot, _axes(float(road.yaw_rad(np.array([spec.station_m]))[0])))
        codes = spec.skiltnummer.split(";")
        faces = [face(code, TEXTS.get(code, "")) for code in codes]
        patches: list[Patch] = []
        bottom = LOWEST_MARKER_M
        for code, plate in reversed(list(zip(codes, faces, strict=True))):
            bottom = bottom if code.startswith("9") else max(bottom, LOWEST_M)
            patches += _plane(plate, here, POLE_RADIUS_M + 0.02, bottom, Kind.SIGN)
            bottom += plate.height_m + PLATE_GAP_M
        pole = _upright(here, -POLE_RADIUS_M, (-POLE_RADIUS_M, POLE_RADIUS_M), (0.0, bottom), (126, 130, 132))
        yield Thing(foot, (pole, *patches))


def _plane(plate: Face, here: Spot, ahead_m: float, bottom_m: float, kind: Kind) -> Iterator[Patch]:
    """Put a drawing upright, its face against the traffic that goes along the road."""
    unit = plate.width_m / 100.0
    top = bottom_m + plate.height_m
    for one in painted(plate):
        rings = []
        for ring in one.rings:
            across, up = (50.0 - ring[:, 0]) * unit, top - ring[:, 1] * unit
            rings.append(here.world(np.stack([np.full(len(ring), -ahead_m), across, up], axis=-1)))
        yield Patch(tuple(rings), one.rgb, kind)


def _upright(
    here: Spot, along_m: float, across_m: tuple[float, float], up_m: tuple[float, float], rgb: Rgb
) -> Patch:
    (y0, y1), (z0, z1) = across_m, up_m
    corners = np.array([[along_m, y0, z0], [along_m, y1, z0], [along_m, y1, z1], [along_m, y0, z1]])
    return Patch((here.world(corners),), rgb)


def _prism(
    here: Spot, profile: Sequence[tuple[float, float]], half_m: float, rgb: Rgb, kind: Kind
) -> Iterator[Patch]:
    """A profile ``(along, up)``, counter-clockwise seen from the right, drawn out across; lit from above."""
    along, up = np.array(profile).T
    right = np.stack([along, np.full_like(along, -half_m), up], axis=-1)
    left = right * [1.0, -1.0, 1.0]
    for i in range(len(profile)):
        k = (i + 1) % len(profile)
        quad = np.array([right[i], right[k], left[k], left[i]])
        (x0, z0), (x1, z1) = profile[i], profile[k]
        rise = abs(x1 - x0) / float(np.hypot(x1 - x0, z1 - z0))
        yield Patch((here.world(quad),), _shaded(rgb, 0.78 + 0.22 * rise), kind, two_sided=False)
    yield Patch((here.world(right[::-1]),), _shaded(rgb, 0.88), kind, two_sided=False)
    yield Patch((here.world(left),), _shaded(rgb, 0.66), kind, two_sided=False)


def _shaded(rgb: Rgb, light: float) -> Rgb:
    return int(rgb[0] * light), int(rgb[1] * light), int(rgb[2] * light)


def _car(here: Spot, rgb: Rgb, number: str) -> Iterator[Patch]:
    """A car of 4.3 m, its front along the place's first axis."""
    body = ((-2.15, 0.32), (2.15, 0.32), (2.15, 0.72), (1.95, 0.86), (-2.1, 0.92))
    cabin = ((-1.85, 0.90), (1.05, 0.86), (0.45, 1.44), (-1.35, 1.46))
    yield from _prism(here, cabin, 0.76, rgb, Kind.VEHICLE)
    for side in (-1.0, 1.0):
        window = np.array([[-1.55, 0.0, 0.96], [0.8, 0.0, 0.93], [0.36, 0.0, 1.36], [-1.22, 0.0, 1.38]])
        window[:, 1] = side * 0.765
        yield Patch((here.world(window[:: int(side)]),), _GLASS, Kind.VEHICLE, two_sided=False)
    for toward, (x0, z0), (x1, z1) in ((1, (1.03, 0.90), (0.53, 1.40)), (-1, (-1.85, 0.96), (-1.45, 1.42))):
        glass = np.array([[x0, -0.62, z0], [x0, 0.62, z0], [x1, 0.56, z1], [x1, -0.56, z1]])
        yield Patch((here.world(glass[::-toward]),), _GLASS, Kind.VEHICLE, two_sided=False)
    yield from _prism(here, body, 0.88, rgb, Kind.VEHICLE)
    for along in (-1.3, 1.3):
        for side in (-1.0, 1.0):
            yield from _wheel(here, along, side)
    for toward, light in ((1, (250, 246, 220)), (-1, (176, 20, 24))):
        for y in (-0.66, 0.66):
            x, y0, y1 = toward * 2.16, y - 0.14, y + 0.14
            lamp = np.array([[x, y0, 0.60], [x, y1, 0.60], [x, y1, 0.74], [x, y0, 0.74]])
            yield Patch((here.world(lamp[::-toward]),), light, Kind.VEHICLE, two_sided=False)
        yield from _number_plate(here, toward * 2.17, number)


def _wheel(here: Spot, along_m: float, side: float) -> Iterator[Patch]:
    angle = np.linspace(0.0, 2.0 * np.pi, 20, endpoint=False) * side
    for radius, shade in ((0.33, (22, 22, 24)), (0.18, (150, 152, 155))):
        x, z = along_m + radius * np.cos(angle), 0.33 + radius * np.sin(angle)
        rim = np.stack([x, np.full(angle.size, side * 0.885), z], axis=-1)
        yield Patch((here.world(rim),), shade, Kind.VEHICLE, two_sided=False)


def _number_plate(here: Spot, along_m: float, number: str) -> Iterator[Patch]:
    height = 100.0 * 0.11 / 0.52
    outline = rectangle(0.0, 0.0, 100.0, height)
    plate = Face(0.52, 0.11, outline, (Text(number, (50.0, 0.5 * height), 13.0, 88.0, "#15171a"),))
    unit, toward = plate.width_m / 100.0, float(np.sign(along_m))
    # Letters run either way round: a speck of the plate's own edge says from where they are seen.
    speck = shrunk(outline, 0.001, (50.0, 0.5 * height))
    for one in painted(plate):
        rings = []
        for ring in (np.array(speck), *one.rings):
            across, up = toward * (ring[:, 0] - 50.0) * unit, 0.56 - ring[:, 1] * unit
            rings.append(here.world(np.stack([np.full(len(ring), along_m), across, up], axis=-1)))
        yield Patch(tuple(rings), one.rgb, Kind.VEHICLE, two_sided=False)


def _number(rng: np.random.Generator) -> str:
    letters = "".join(rng.choice(list("ABCDEFHJKLNPRSTUVXYZ"), 2))
    return f"{letters} {int(rng.integers(10_000, 99_999))}"


def _person(i: int, rng: np.random.Generator) -> Face:
    """A person as a cut-out of 1.6 to 1.9 m."""
    tall = float(rng.uniform(1.6, 1.9))
    jacket, skin = _JACKETS[i % len(_JACKETS)], _SKIN[i % len(_SKIN)]
    hair, trousers = _HAIR[i % len(_HAIR)], _TROUSERS[i % len(_TROUSERS)]
    shapes: tuple[Shape, ...] = (
        Line(((44.0, 150.0), (38.0, 205.0), (34.0, 258.0)), 17.0, trousers),
        Line(((58.0, 150.0), (64.0, 205.0), (70.0, 256.0)), 17.0, trousers),
        Line(((30.0, 262.0), (38.0, 262.0)), 11.0, "#1a1a1a"),
        Line(((68.0, 261.0), (77.0, 261.0)), 11.0, "#1a1a1a"),
        Line(((33.0, 62.0), (22.0, 108.0), (26.0, 148.0)), 14.0, jacket),
        Line(((69.0, 62.0), (80.0, 108.0), (76.0, 146.0)), 14.0, jacket),
        Disc((26.0, 153.0), 7.0, skin),
        Disc((76.0, 151.0), 7.0, skin),
        Polygon(_TORSO, jacket),
        Polygon(rectangle(45.0, 36.0, 57.0, 50.0), skin),
        Disc((51.0, 24.0), 19.0, hair),
        Disc((51.0, 27.0), 16.0, skin),
        Disc((45.0, 25.0), 2.0, "#222222"),
        Disc((57.0, 25.0), 2.0, "#222222"),
        Line(((46.0, 35.0), (51.0, 37.0), (56.0, 35.0)), 2.0, "#9b4a3c"),
    )
    # No plate behind a person: the outline is a speck within the jacket.
    speck = rectangle(50.0, 80.0, 51.0, 81.0)
    return Face(tall * 100.0 / 268.0, tall, speck, shapes)


def _houses(road: Road, rng: np.random.Generator) -> Iterator[Thing]:
    for i, station in enumerate(np.arange(20.0, road.spec.length_m + 60.0, 38.0)):
        side = -1.0 if i % 2 else 1.0
        here = spot(road, float(station + rng.uniform(-6.0, 6.0)), side * float(rng.uniform(20.0, 30.0)))
        rgb, long, tall = (
            _HOUSES[i % len(_HOUSES)],
            float(rng.uniform(4.0, 6.5)),
            float(rng.uniform(2.8, 5.2)),
        )
        walls = ((-long, -1.0), (long, -1.0), (long, tall), (-long, tall))
        roof = ((-long - 0.4, tall), (long + 0.4, tall), (0.0, tall + 2.6))
        patches = [
            *_prism(here, roof, 4.4, (84, 78, 76), Kind.OTHER),
            *_prism(here, walls, 4.0, rgb, Kind.OTHER),
        ]
        patches += [
            _upright(here, -long - 0.02, (y - 0.6, y + 0.6), (1.0, 2.2), (58, 70, 82))
            for y in (-2.2, 0.0, 2.2)
        ]
        yield Thing(here.origin_m, tuple(patches))


def _trees(road: Road, rng: np.random.Generator) -> Iterator[Thing]:
    for station in np.arange(-20.0, road.spec.length_m + 75.0, 7.0):
        side = -1.0 if rng.random() < 0.5 else 1.0
        at = min(float(station + rng.uniform(-3.0, 3.0)), road.spec.length_m + 75.0)
        here = spot(road, at, side * float(rng.uniform(13.0, 34.0)))
        tall = float(rng.uniform(4.0, 10.0))
        shades = [(int(38 * k), int(78 * k), int(44 * k)) for k in rng.uniform(0.8, 1.25, 3)]
        patches = [_upright(here, 0.0, (-0.15, 0.15), (-0.5, 0.3 * tall), (84, 62, 46))]
        for k, shade in enumerate(shades):
            low, high, half = tall * (0.16 + 0.24 * k), tall * (0.56 + 0.22 * k), tall * (0.26 - 0.06 * k)
            corners = np.array([[0.0, -half, low], [0.0, half, low], [0.0, 0.0, high]])
            patches.append(Patch((here.world(corners),), shade))
        yield Thing(here.origin_m, tuple(patches))
