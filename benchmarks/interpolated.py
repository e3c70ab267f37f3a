"""KITTI's boxes as CVAT tracks with key frames every 0.3, 0.5 and 1 s, through `twin ingest-drive`.

Usage: python benchmarks/interpolated.py

A person sets a box in every third, fifth or tenth picture, and in the last; CVAT draws those between on
straight lines and ends the track with a row that is outside. Every picture from which a person may begin is
tried, so that few signs give many answers. Needs the recordings beside the checkout, as `real.py` does.

The bars: errors at most 1.15 times those of the key frames alone, and 90 % of the signs inside their ellipse.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from real import Errors, errors_of
from real_drives import REAL, RealDrive, new_annotations
from real_kitti import CAMERA, Boxes, intrinsics_of, kitti_drives, object_name, sign_boxes

from geoloc.arrays import FloatArray, IntArray
from twin.cli.output import print_table

STEPS = (3, 5, 10)
"""Pictures from one key frame to the next; KITTI took ten a second."""
MOST_WORSE, LEAST_INSIDE = 1.15, 0.90
KEYS, MARKED, UNMARKED = "key frames alone", "interpolated", "interpolated, and not marked so"


def key_frames(frames: IntArray, step: int, begin: int) -> IntArray:
    """Frames that a person sets: every `step` from the `begin`-th of the sign's boxes, and the last one."""
    wanted = np.arange(frames[min(begin, frames.size - 1)], frames[-1], step)
    nearest = frames[np.abs(frames[:, None] - wanted).argmin(axis=0)] if wanted.size else frames[:0]
    return np.unique([*nearest, frames[-1]])


def write_tracks(folder: Path, sequence: str, step: int, begin: int, how: str) -> None:
    """Write the boxes of a KITTI drive folder anew, as a CVAT video task exports them.

    Parameters
    ----------
    how : str
        `KEYS`, `MARKED` or `UNMARKED`.
    """
    size = intrinsics_of(sequence)
    root = new_annotations()
    for number, (sign, boxes) in enumerate(sign_boxes(sequence, REAL / "kitti_signs").items()):
        track = ET.SubElement(root, "track", id=str(number), label="sign", source="manual")
        name = object_name(sequence, sign)
        for frame, box, is_key in _rows(boxes, key_frames(boxes.frame, step, begin)):
            if is_key or how != KEYS:
                limit = np.array([size.width_px, size.height_px] * 2)
                _add(track, frame, np.clip(box + 0.5, 0.0, limit), name, is_key=is_key or how == UNMARKED)
        _add(track, frame + 1, np.clip(box + 0.5, 0.0, limit), name, is_key=True, outside=True)
    ET.ElementTree(root).write(folder / f"{CAMERA}.xml", encoding="utf-8")


def _rows(boxes: Boxes, keys: IntArray) -> Iterable[tuple[int, FloatArray, bool]]:
    """Yield every frame from the first key frame to the last: its corners, and whether somebody set them."""
    set_px = boxes.box_px[np.searchsorted(boxes.frame, keys)]
    frames = np.arange(keys[0], keys[-1] + 1)
    drawn = np.stack([np.interp(frames, keys, edge) for edge in set_px.T], axis=1)
    yield from zip(frames.tolist(), drawn, np.isin(frames, keys).tolist(), strict=True)


def _add(
    track: ET.Element, frame: int, box: FloatArray, name: str, *, is_key: bool, outside: bool = False
) -> None:
    edges = dict(zip(("xtl", "ytl", "xbr", "ybr"), (f"{x:.2f}" for x in box), strict=True))
    state = {"outside": f"{outside:d}", "occluded": "0", "keyframe": f"{is_key:d}"}
    row = ET.SubElement(track, "box", {"frame": str(frame), **state, **edges, "z_order": "0"})
    ET.SubElement(row, "attribute", name="object").text = name


def together(results: list[Errors]) -> Errors:
    """Put the answers of several beginnings into one."""
    return Errors(
        results[0].method,
        tuple(name for one in results for name in one.names),
        np.concatenate([one.offset_m for one in results]),
        np.concatenate([one.covariance_m2 for one in results]),
        tuple(name for one in results for name in one.missed),
    )


def errors_by_step(drives: list[RealDrive], work: Path, step: int, how: str) -> Errors:
    """Ingest the drives once from every beginning."""
    results = []
    for begin in range(step):
        for drive in drives:
            write_tracks(drive.folder, drive.folder.name[-2:], step, begin, how)
        results.append(errors_of(drives, "adjusted", work / f"{step}-{begin}-{how}.db"))
    return together(results)


def main() -> None:
    """Print the table; exit with 1 where a bar is missed."""
    if not REAL.exists():
        sys.exit(f"The real recordings are not in {REAL}: put them there, their licences forbid a copy here.")
    rows: list[tuple[object, ...]] = []
    missed = False
    with tempfile.TemporaryDirectory() as folder:
        drives = kitti_drives(Path(folder) / "kitti")
        for step in STEPS:
            keys, marked, unmarked = (
                errors_by_step(drives, Path(folder), step, how) for how in (KEYS, MARKED, UNMARKED)
            )
            for how, errors in ((KEYS, keys), (MARKED, marked), (UNMARKED, unmarked)):
                s = errors.summary()
                numbers = (s["mean"], s["median"], s["p90"], f"{s['coverage95']:.0%}")
                rows.append((f"every {step / 10:g} s: {how}", int(s["n"]), *numbers, len(errors.missed)))
            is_kept = all(
                marked.summary()[x] <= MOST_WORSE * keys.summary()[x] for x in ("mean", "median", "p90")
            )
            missed |= not is_kept or marked.summary()["coverage95"] < LEAST_INSIDE
    columns = ["KITTI's boxes", "n", "mean [m]", "median [m]", "p90 [m]", "in 95 % ellipse", "no position"]
    print_table("Tracks between key frames, horizontal error", columns, rows)
    if missed:
        sys.exit(f"A bar is missed: {MOST_WORSE} times the error of key frames, {LEAST_INSIDE:.0%} inside.")


if __name__ == "__main__":
    main()
