"""Real drives with surveyed objects: KITTI's boxed signs and an Argoverse 2 log, through `twin ingest-drive`.

Usage: python benchmarks/real.py

Needs the recordings beside the checkout (``../shared/real``): their licences do not allow a copy here. Errors
do not depend on the machine; nothing here is a timing.

KITTI: 28 signs in five sequences (those of 33 that were boxed in at least three frames), boxes by hand,
centres by laser scanner. The published errors on all 73 signs: plain robust triangulation 0.41 m mean,
0.28 m median, 0.94 m p90 over the 48 it gives; the best, 0.26 m mean (Chawla et al. 2020, relative).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sqlalchemy as sa
from real_drives import REAL, RealDrive, argoverse_drive, argoverse_feet
from real_kitti import kitti_drives

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import enu_offset, geographic_from_enu, rotation_enu_from_rig, utm33_from_geographic
from geoloc.locate.accuracy import ellipse_coverage
from twin.cli.output import print_table
from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.ingest.ingest import ingest_drive
from twin.ingest.locate import trajectory_of
from twin.reports.evaluation import read_truth
from twin.store import schema
from twin.store.store import Store

PLAIN = "plain triangulation"
MIN_FEET_FRAMES = 10
"""Argoverse objects seen in fewer frames are left out."""
ANNOTATOR_PX = 1.5
HUBER_RAD = 0.003
"""Bearings that miss by more than this (two pixels of KITTI) weigh less."""
ROUNDS = 30


@dataclass(frozen=True, slots=True)
class Errors:
    """Estimates of one method against the truth, EPSG:25833.

    Attributes
    ----------
    names : tuple of str
        Objects with a truth and an estimate.
    offset_m : float64 (n, 2)
    covariance_m2 : float64 (n, 2, 2)
        NaN where the method states none.
    missed : tuple of str
        Objects with a truth, but no estimate.
    """

    method: str
    names: tuple[str, ...]
    offset_m: FloatArray
    covariance_m2: FloatArray
    missed: tuple[str, ...]

    @property
    def error_m(self) -> FloatArray:
        """Horizontal."""
        return np.asarray(np.hypot(self.offset_m[:, 0], self.offset_m[:, 1]))

    def summary(self) -> dict[str, float]:
        """``n``, ``mean``, ``median``, ``p90``, ``coverage95`` (NaN where no covariance is stated)."""
        error = self.error_m
        return {
            "n": len(error),
            "mean": float(error.mean()),
            "median": float(np.median(error)),
            "p90": float(np.percentile(error, 90)),
            "coverage95": ellipse_coverage(self.offset_m, self.covariance_m2),
        }


def errors_of(drives: Sequence[RealDrive], method: str, store: Path) -> Errors:
    """Ingest drives by a method of twin, and compare the estimates with the truth.

    Parameters
    ----------
    store : Path
        Made if it does not exist.
    """
    with Store.open(store) as opened:
        for drive in drives:
            ingest_drive(opened, drive.folder, method=method)
        rows = opened.rows(sa.select(schema.estimate).where(schema.estimate.c.method == method))
    found = {
        row["object"]: (
            np.array([row["east_m"], row["north_m"]]),
            np.array([[row["cov_ee_m2"], row["cov_en_m2"]], [row["cov_en_m2"], row["cov_nn_m2"]]]),
        )
        for row in rows
    }
    return _compared(method, drives, found)


def plain_errors(drives: Sequence[RealDrive]) -> Errors:
    """Triangulate every object by itself, poses and calibration taken as exact: the published baseline."""
    nothing = np.full((2, 2), np.nan)
    found: dict[str, tuple[FloatArray, FloatArray]] = {}
    for drive in drives:
        found |= {name: (place, nothing) for name, place in triangulate(read_drive(drive.folder)).items()}
    return _compared(PLAIN, drives, found)


def triangulate(drive: Drive) -> dict[str, FloatArray]:
    """Object → EPSG:25833 ``(2,)``: where its bearings meet best, each object by itself.

    Least squares of the angles by which rays miss the point, with Huber's weights; every frame weighs the
    same.
    """
    notes = drive.annotations
    epoch = np.array([drive.frame_epoch_ns[c][f] for c, f in zip(notes.camera, notes.frame, strict=True)])
    poses = trajectory_of(drive).poses_at(epoch + drive.camera_offset_ns)
    enu_R_rig = rotation_enu_from_rig(poses.heading_deg, poses.pitch_deg, poses.roll_deg)
    ray, eye = np.empty((len(epoch), 3)), np.empty((len(epoch), 3))
    for name in np.unique(notes.camera):
        mine, camera = notes.camera == name, drive.rig.camera(str(name))
        ray_camera, _ = camera.model.camera_ray_from_pixel(notes.pixel_px[mine])
        ray[mine] = np.einsum("nij,nj->ni", enu_R_rig[mine] @ camera.rig_R_camera, ray_camera)
        eye[mine] = enu_R_rig[mine] @ camera.rig_t_camera_m
    places = {}
    for name in np.unique(notes.object):
        mine = np.flatnonzero(notes.object == name)
        lat, lon = poses.latitude_deg[mine], poses.longitude_deg[mine]
        east, north = enu_offset(lat[0], lon[0], lat, lon)[:2]
        rig = np.stack([east, north, poses.height_m[mine]], axis=-1)
        point = meeting_point(rig + eye[mine], ray[mine])
        place = geographic_from_enu(lat[:1], lon[:1], point[:1], point[1:2])
        places[str(name)] = np.concatenate(utm33_from_geographic(*place[:2]))
    return places


def meeting_point(eye_m: FloatArray, ray: FloatArray) -> FloatArray:
    """Point ``(3,)`` that unit rays ``(n, 3)`` from `eye_m` ``(n, 3)`` miss least, as angles, robustly."""
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    weight, point = np.ones(len(ray)), np.zeros(3)
    for _ in range(ROUNDS):
        normal = np.einsum("n,nij->ij", weight, across)
        point = np.linalg.solve(normal, np.einsum("n,nij,nj->i", weight, across, eye_m))
        distance = np.linalg.norm(point - eye_m, axis=1)
        angle = np.linalg.norm(np.einsum("nij,nj->ni", across, point - eye_m), axis=1) / distance
        weight = np.minimum(1.0, HUBER_RAD / np.maximum(angle, 1e-12)) / distance**2
    return point


def _compared(
    method: str, drives: Sequence[RealDrive], found: dict[str, tuple[FloatArray, FloatArray]]
) -> Errors:
    truths = {t.object: (t.east_m, t.north_m) for drive in drives for t in read_truth(drive.truth)}
    names = tuple(name for name in sorted(truths) if name in found)
    return Errors(
        method=method,
        names=names,
        offset_m=np.array([found[n][0] - truths[n] for n in names]).reshape(-1, 2),
        covariance_m2=np.array([found[n][1] for n in names]).reshape(-1, 2, 2),
        missed=tuple(sorted(set(truths) - set(names))),
    )


def seen_often(errors: Errors, source: Path = REAL / "av2") -> Errors:
    """Keep the Argoverse objects that were seen in at least ten frames."""
    frames = argoverse_feet(source).groupby("object").timestamp_ns.nunique()
    often = set(frames[frames >= MIN_FEET_FRAMES].index)
    keep = [i for i, name in enumerate(errors.names) if name in often]
    return Errors(
        errors.method,
        tuple(errors.names[i] for i in keep),
        errors.offset_m[keep],
        errors.covariance_m2[keep],
        tuple(name for name in errors.missed if name in often),
    )


def _print(title: str, results: Iterable[Errors], single: bool) -> None:
    rows: list[tuple[object, ...]] = []
    for result in results:
        s = result.summary()
        covered = f"{s['coverage95']:.0%}" if np.isfinite(s["coverage95"]) else "–"
        rows.append((result.method, int(s["n"]), s["mean"], s["median"], s["p90"], covered))
        if single:
            for name, error in zip(result.names, result.error_m, strict=True):
                rows.append((f"  {name}", 1, float(error), None, None, ""))
        if result.missed:
            rows.append((f"  no position: {', '.join(result.missed)}", len(result.missed)))
    print_table(title, ["method", "n", "mean [m]", "median [m]", "p90 [m]", "in 95 % ellipse"], rows)


def main() -> None:
    """Print one table a recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--objects", action="store_true", help="also the error of every object")
    single = parser.parse_args().objects
    if not REAL.exists():
        sys.exit(f"The real recordings are not in {REAL}: put them there, their licences forbid a copy here.")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        kitti = kitti_drives(out / "kitti")
        results = [plain_errors(kitti), errors_of(kitti, "adjusted", out / "kitti.db")]
        _print("KITTI: signs' faces, horizontal error", results, single)
        for noise_px in (0.0, ANNOTATOR_PX):
            log = [argoverse_drive(out / f"argoverse-{noise_px:g}", noise_px=noise_px)]
            store = out / f"argoverse-{noise_px:g}.db"
            results = [seen_often(errors_of(log, method, store)) for method in ("single-frame", "adjusted")]
            pixels = f"{noise_px:g} px of noise added" if noise_px else "pixels and poses are exact"
            _print(f"Argoverse 2: feet in {MIN_FEET_FRAMES} frames or more, {pixels}", results, single)


if __name__ == "__main__":
    main()
