"""A simulated drive past objects on the ground: damages, a kerb, guard rails, lamp posts, with their truth.

The drive is the scenario ``sample`` with its signs. The corners of the objects lie on the simulated road, are
projected through the true camera, and clicked with the annotator's trembling hand, as every sighting is.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.simulation.scenarios import PoleSpec
from geoloc.simulation.simulate import Scenario, SimulatedDrive, scenario, simulate_drive
from twin.drives.annotations.write_cvat import CORNER_PX
from twin.samples.write_drive import write_driveworks_trip

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

CAMERA = "C3_tricam120"
TRUTH = "truth.geojson"
_EVERY = 12
"""Every so many frames somebody draws: 4.4 m at 40 km/h."""
_RANGE_M = (2.0, 32.0)
_TAGS = {"point": "points", "line": "polyline", "area": "polygon"}
LABELS = """\
[labels]
"krakelering" = { type = 123, ground = true }  # Tilstand/skade, dekke
"kantstein" = { type = 9, ground = true }
"rekkverk" = { type = 5, ground = true }       # along the foot of its posts
"lysmast" = { type = 181, ground = true }
"""


@dataclass(frozen=True, slots=True)
class TrueObject:
    """One object: corners as (station, offset to the left) along the simulated road, metres."""

    name: str
    label: str
    kind: str
    corners: tuple[tuple[float, float], ...]


def _along(
    first_m: float, last_m: float, offset_m: float, step_m: float = 1.0
) -> tuple[tuple[float, float], ...]:
    stations = np.linspace(first_m, last_m, round((last_m - first_m) / step_m) + 1)
    return tuple((float(station), offset_m) for station in stations)


OBJECTS = (
    TrueObject(
        "damage 1",
        "krakelering",
        "area",
        ((70, -0.7), (72.4, -0.5), (73.1, -1.6), (71.9, -2.5), (69.8, -2.1)),
    ),
    TrueObject("damage 2", "krakelering", "area", ((231, -2.2), (236, -2.3), (236, -2.9), (231, -2.8))),
    TrueObject("damage 3", "krakelering", "area", ((330, 1.1), (331.2, 1.0), (331.3, 2.2), (330.1, 2.3))),
    TrueObject("kerb", "kantstein", "line", _along(90.0, 150.0, -3.4)),
    TrueObject("rail 1", "rekkverk", "line", _along(200.0, 280.0, -4.2, 2.0)),
    TrueObject("rail 2", "rekkverk", "line", _along(340.0, 372.0, -4.2, 2.0)),
    TrueObject("lamp 1", "lysmast", "point", ((120.0, -5.0),)),
    TrueObject("lamp 2", "lysmast", "point", ((300.0, -5.2),)),
    TrueObject("lamp 3", "lysmast", "point", ((390.0, -5.0),)),
)


def simulate_ground_objects(
    folder: Path | str, seed: int = 0, *, world: Scenario | None = None
) -> list[Path]:
    """Write the drive, what was drawn, `TRUTH`, and NVDB as it might be, a GeoJSON a type.

    NVDB has the kerb 20 m too short, one damage of three, and rail 1 in two pieces. It does not know lamp 2,
    and has a lamp that is gone.

    Parameters
    ----------
    folder : Path or str
        Made if it does not exist; files of an earlier call are replaced.
    seed : int
        Draws all errors.
    world : Scenario, optional
        On a road like that of ``sample``, which it is unless given.
    """
    folder = Path(folder)
    world = world or scenario("sample", None, seed)
    paths = write_driveworks_trip(simulate_drive(world, seed), folder)
    poles = tuple(
        PoleSpec(f"{number}", "", *corner)
        for number, corner in enumerate(corner for one in OBJECTS for corner in one.corners)
    )
    seen = simulate_drive(
        replace(
            world,
            poles=poles,
            cameras=(CAMERA,),
            annotate_every=_EVERY,
            range_m=_RANGE_M,
            # What is drawn has no thickness, and who slips sees a crooked outline.
            noise=replace(world.noise, pole_radius_m=0.0, blunder_rate=0.0),
            road=replace(world.road, kerb_share=0.0),
        ),
        seed,
    )
    corners = np.stack([seen.objects.longitude_deg, seen.objects.latitude_deg, seen.objects.height_m], axis=1)
    truth = dict(zip((one.name for one in OBJECTS), _parted(corners), strict=True))
    kinds = {one.name: one.kind for one in OBJECTS}
    true = {name: _shape(corners, kinds[name]) for name, corners in truth.items()}
    files = {f"{CAMERA}_ground.xml": _cvat(seen), "labels.toml": LABELS, TRUTH: _geojson(true)}
    files |= {f"nvdb_{number}.geojson": _geojson(known) for number, known in _nvdb(truth).items()}
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return paths + [folder / name for name in files]


def _parted(rows: FloatArray) -> list[FloatArray]:
    """Rows of all corners → those of each object."""
    return np.split(rows, np.cumsum([len(one.corners) for one in OBJECTS])[:-1])


def _cvat(seen: SimulatedDrive) -> str:
    """Every drawing is a track of one picture, as CVAT exports what somebody drew in a video task."""
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<annotations>", "  <version>1.1</version>"]
    for number, (one, frame, pixel_px) in enumerate(_drawings(seen)):
        points = ";".join(f"{x + CORNER_PX:.2f},{y + CORNER_PX:.2f}" for x, y in pixel_px.tolist())
        tag = _TAGS[one.kind]
        lines += [
            f'  <track id="{number}" label={quoteattr(one.label)}>',
            *(
                f'    <{tag} frame="{frame + gone}" outside="{gone}" keyframe="1" points="{points}"/>'
                for gone in (0, 1)
            ),
            "  </track>",
        ]
    return "\n".join([*lines, "</annotations>"]) + "\n"


def _drawings(seen: SimulatedDrive) -> Iterator[tuple[TrueObject, int, FloatArray]]:
    """Yield an object, a frame, and the corners of it that show there."""
    rows = seen.sightings
    starts = np.cumsum([0, *(len(one.corners) for one in OBJECTS)])
    model = seen.rig.camera(CAMERA).model
    size_px = np.array([model.width_px, model.height_px], dtype=np.float64)
    for k, one in enumerate(OBJECTS):
        own = (rows.object_index >= starts[k]) & (rows.object_index < starts[k + 1])
        for frame in np.unique(rows.frame[own]).tolist():
            shown = np.flatnonzero(own & (rows.frame == frame))
            shown = shown[np.argsort(rows.object_index[shown])]
            enough = len(one.corners) if one.kind == "area" else min(2, len(one.corners))
            if len(shown) >= enough:
                is_cut = one.kind == "line" and rows.object_index[shown[0]] > starts[k]
                pixel_px = rows.pixel_px[shown]
                yield one, frame, _to_the_border(pixel_px, size_px) if is_cut else pixel_px


def _to_the_border(pixel_px: FloatArray, size_px: FloatArray) -> FloatArray:
    """Draw a line that has begun behind the car from the border of the picture, as people do."""
    first, step = pixel_px[0], pixel_px[0] - pixel_px[1]
    with np.errstate(divide="ignore"):
        ways = np.where(step > 0.0, (size_px - 1.0 - first) / step, -first / step)
    return np.concatenate([[first + step * max(0.0, float(ways.min()))], pixel_px])


def _nvdb(truth: Mapping[str, FloatArray]) -> dict[int, dict[str, BaseGeometry]]:
    """What NVDB has, by type."""
    import shapely

    gone = shapely.Point(truth["lamp 3"][0] + np.array([4e-4, 0.0, 0.0]))
    rail = truth["rail 1"]
    return {
        123: {"900001": _shape(truth["damage 1"], "area")},
        9: {"900002": _shape(truth["kerb"][:41], "line")},
        5: {
            "900003": _shape(rail[:17], "line"),
            "900004": _shape(rail[16:], "line"),
            "900005": _shape(truth["rail 2"], "line"),
        },
        181: {
            "900006": _shape(truth["lamp 1"], "point"),
            "900007": gone,
            "900008": _shape(truth["lamp 3"], "point"),
        },
    }


def _geojson(objects: Mapping[str, BaseGeometry]) -> str:
    from shapely.geometry import mapping

    features = [
        {"type": "Feature", "properties": {"id": name}, "geometry": mapping(shape)}
        for name, shape in objects.items()
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}) + "\n"


def _shape(corners: FloatArray, kind: str) -> BaseGeometry:
    import shapely

    if kind == "point":
        return shapely.Point(corners[0])
    return shapely.Polygon(corners) if kind == "area" else shapely.LineString(corners)
