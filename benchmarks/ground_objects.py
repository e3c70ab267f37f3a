"""Objects on the ground against their truth: simulated drives, annotations as files, located as a user would.

python benchmarks/ground_objects.py                    # 20 drives, against the bars
python benchmarks/ground_objects.py --rough --seeds 10 # with the crossfall and noise of other scenarios
python benchmarks/ground_objects.py --seeds 1 --picture docs/images/objects.png
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from geoloc.earth.geodesy import utm33_covariance_from_enu, utm33_from_geographic
from geoloc.simulation.simulate import NoiseSpec, RoadSpec, Scenario, scenario
from twin.objects.locate import DriveObjects, GroundObject, locate_objects
from twin.objects.shapes import plane_geometry
from twin.samples.ground_objects import CAMERA, TRUTH, simulate_ground_objects

CHI2_95 = {1: 3.841458820694124, 2: 5.991464547107979}
BARS = {
    "inside 95 %": (0.9, 1.0),
    "NEES a degree of freedom": (0.0, 1.5),
    "size: error in sigmas, rms": (0.0, 1.5),
}


@dataclass
class Errors:
    """Errors of one kind of object over all drives."""

    metres: list[float] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    inside: list[bool] = field(default_factory=list)
    size_error: list[float] = field(default_factory=list)
    size_sigmas: list[float] = field(default_factory=list)
    n_missing: int = 0
    n_extra: int = 0


def main() -> int:
    """Run the drives, print the table, tell by the exit code whether the bars are met."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--rough", action="store_true")
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    errors: dict[str, Errors] = defaultdict(Errors)
    for seed in range(arguments.seeds):
        with tempfile.TemporaryDirectory() as folder:
            simulate_ground_objects(folder, seed, world=_rough(seed) if arguments.rough else None)
            found, truth = locate_objects(folder), _truth(Path(folder) / TRUTH)
        _measure(found, truth, errors)
        if seed == 0 and arguments.picture:
            _picture(found, truth, arguments.picture)
    return _print(errors, arguments.seeds)


def _rough(seed: int) -> Scenario:
    """The same road with the crossfall and the noise that the other scenarios have."""
    world, usual = scenario("sample", None, seed), RoadSpec()
    across = (usual.crossfall_percent, usual.crossfall_spread)
    road = replace(world.road, crossfall_percent=across[0], crossfall_spread=across[1])
    return replace(world, road=road, noise=NoiseSpec())


def _truth(path: Path) -> list[tuple[str, BaseGeometry]]:
    """Kind and geometry in EPSG:25833."""
    kinds = {"Point": "point", "LineString": "line", "Polygon": "area"}
    shapes = []
    for feature in json.loads(path.read_text())["features"]:
        shape = shapely.from_geojson(json.dumps(feature["geometry"]))
        grid = shapely.transform(
            shape, lambda at: np.stack(utm33_from_geographic(at[:, 1], at[:, 0]), axis=1)
        )
        shapes.append((kinds[shape.geom_type], grid))
    return shapes


def _measure(found: DriveObjects, truth: list[tuple[str, BaseGeometry]], errors: dict[str, Errors]) -> None:
    left = list(found.objects)
    for kind, shape in truth:
        own = errors[kind]
        near = [one for one in left if one.kind == kind and plane_geometry(one).distance(shape) < 3.0]
        if not near:
            own.n_missing += 1
            continue
        one = min(near, key=lambda other: plane_geometry(other).hausdorff_distance(shape))
        left = [other for other in left if other is not one]
        _errors_of(one, shape, own)
    for one in left:
        errors[one.kind].n_extra += 1


def _errors_of(one: GroundObject, shape: BaseGeometry, own: Errors) -> None:
    outline = one.outline
    covariance = utm33_covariance_from_enu(outline.corner_m2, outline.latitude_deg, outline.longitude_deg)
    corners = np.stack(utm33_from_geographic(outline.latitude_deg, outline.longitude_deg), axis=1)
    if isinstance(shape, shapely.LineString):
        # Across alone: which place of the line a corner shows nobody knows.
        at = shapely.line_locate_point(shape, shapely.points(corners))
        inner = (at > 0.1) & (at < shape.length - 0.1)
        ahead, behind = (
            shapely.get_coordinates(shapely.line_interpolate_point(shape, at + step))
            for step in (0.05, -0.05)
        )
        along = (ahead - behind) / np.hypot(*(ahead - behind).T)[:, None]
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
        off = np.einsum("ki,ki->k", corners - (ahead + behind) / 2.0, normal)[inner]
        variance = np.einsum("ki,kij,kj->k", normal, covariance, normal)[inner]
        nees, degrees, metres = off**2 / variance, 1, np.abs(off)
    else:
        true = shapely.get_coordinates(shape)[: len(corners)]
        off = corners - true
        nees = np.einsum("ki,kij,kj->k", off, np.linalg.inv(covariance), off)
        degrees, metres = 2, np.hypot(*off.T)
    own.metres += metres.tolist()
    own.nees += (nees / degrees).tolist()
    own.inside += (nees <= CHI2_95[degrees]).tolist()
    measure, size = one.length or one.area, shape.length if one.kind == "line" else shape.area
    if measure is not None:
        own.size_error.append(measure.value - size)
        own.size_sigmas.append((measure.value - size) / measure.sigma)


def _print(errors: dict[str, Errors], seeds: int) -> int:
    print(f"{seeds} simulated drives, annotated in {CAMERA}")
    print("| kind | corners | median m | inside 95 % | NEES | size: median | rms in sigmas | lost | extra |")
    print("|---|---|---|---|---|---|---|---|---|")
    ok = True
    for kind, own in sorted(errors.items()):
        inside, nees = float(np.mean(own.inside)), float(np.mean(own.nees))
        rms = float(np.sqrt(np.mean(np.square(own.size_sigmas)))) if own.size_sigmas else 0.0
        values = dict(zip(BARS, (inside, nees, rms), strict=True))
        ok &= all(low <= values[name] <= high for name, (low, high) in BARS.items())
        size = f"{np.median(own.size_error):+.2f}" if own.size_error else "–"
        print(
            f"| {kind} | {len(own.nees)} | {np.median(own.metres):.2f} | {100 * inside:.0f} % | {nees:.2f} |"
            f" {size} | {rms:.2f} | {own.n_missing} | {own.n_extra} |"
        )
        ok &= own.n_missing == 0 and own.n_extra == 0
    print("within the bars" if ok else f"NOT within the bars {BARS}, none lost, none extra")
    return 0 if ok else 1


def _picture(found: DriveObjects, truth: list[tuple[str, BaseGeometry]], path: Path) -> None:
    """A damage and the beginning of the kerb: as drawn in a picture, and on the ground with ellipses."""
    from matplotlib.figure import Figure

    from twin.figures import png

    pictures = {
        one.object: [
            row for row in found.drive.on_ground if (row.camera, row.frame) == (one.camera, one.frame)
        ]
        for one in found.objects
    }
    areas = [one for one in found.objects if one.kind == "area"]
    damage = max(areas, key=lambda one: sum(len(row.outline_px) for row in pictures[one.object]))
    drawn = pictures[damage.object]
    figure = Figure(figsize=(10.5, 4.2), dpi=110, layout="constrained")
    left, right = figure.subplots(1, 2)
    for row in drawn:
        pixels = np.array([*row.outline_px, row.outline_px[0]] if row.kind == "area" else row.outline_px)
        colour = "tab:orange" if row.kind == "area" else "tab:blue"
        left.plot(*pixels.T, "o-", color=colour, markersize=3, label=f"{row.label}, drawn")
    model = found.drive.rig.camera(damage.camera).model
    left.set(
        xlim=(0, model.width_px), ylim=(model.height_px, 0), aspect="equal", xlabel="u, px", ylabel="v, px"
    )
    left.set_title(f"{damage.camera}, frame {damage.frame}", fontsize=9)
    left.legend(fontsize=7, loc="upper right")
    centre = plane_geometry(damage).centroid
    for kind, shape in truth:
        if kind != "point" and shape.distance(centre) < 30.0:
            ring = shapely.get_coordinates(shape) - [centre.x, centre.y]
            right.plot(*ring.T, color="black", linewidth=1.2, label="truth" if kind == "area" else None)
    turn = np.linspace(0.0, 2.0 * np.pi, 65)
    circle = np.sqrt(CHI2_95[2]) * np.stack([np.cos(turn), np.sin(turn)])
    outline = damage.outline
    corners = np.stack(utm33_from_geographic(outline.latitude_deg, outline.longitude_deg), axis=1)
    covariance = utm33_covariance_from_enu(outline.corner_m2, outline.latitude_deg, outline.longitude_deg)
    for one in found.objects:
        if one.kind == "line":
            for part in shapely.get_parts(plane_geometry(one)):
                right.plot(
                    *(shapely.get_coordinates(part) - [centre.x, centre.y]).T, color="tab:blue", linewidth=1
                )
    for at, one in zip(corners, covariance, strict=True):
        ring = (np.linalg.cholesky(one) @ circle).T + at - [centre.x, centre.y]
        right.plot(*ring.T, color="tab:orange", linewidth=0.8)
    closed = np.concatenate([corners, corners[:1]]) - [centre.x, centre.y]
    right.plot(*closed.T, "o-", color="tab:orange", markersize=3, label="located, with 95 % ellipses")
    right.set(xlim=(-9, 9), ylim=(-7, 7), aspect="equal", xlabel="east, m", ylabel="north, m (EPSG:25833)")
    area = damage.outline.area()
    right.set_title(f"{damage.label}: {area.value:.1f} ± {area.sigma:.1f} m²", fontsize=9)
    right.legend(fontsize=7, loc="upper right")
    path.write_bytes(png(figure))


if __name__ == "__main__":
    sys.exit(main())
