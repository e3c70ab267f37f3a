"""A drive to try things on: simulated from a scenario and a seed, with its truth beside it."""

from __future__ import annotations

import ast
import csv
import inspect
import io
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geoloc.simulation.car import CAMERAS
from geoloc.simulation.noise import NoiseSpec
from geoloc.simulation.simulate import SCENARIOS, Scenario, SimulatedDrive, scenario, simulate_drive
from twin import __version__
from twin.drives.annotations.write_cvat import LABEL
from twin.errors import ConfigError, RefusedError
from twin.samples.write_drive import write_driveworks_trip
from twin.store.folders import make_folder

TRUTH, NOTES = "truth.csv", "simulation.md"
MOST_ANTENNAS = 2


@dataclass(frozen=True, slots=True)
class SimulateReport:
    """What was written.

    Attributes
    ----------
    folder : Path
        A DriveWorks trip, as ``twin ingest-drive`` reads it.
    speed_kmh : float
        As asked for, or the scenario's own.
    cameras : tuple of str
        Those with annotations.
    n_frames : int
        Frames of each camera.
    n_objects, n_sightings : int
        Poles, and annotated feet in all cameras together.
    files : tuple of Path
        ``truth.csv`` and ``simulation.md`` last.
    """

    folder: Path
    scenario: str
    speed_kmh: float
    seed: int
    cameras: tuple[str, ...]
    antennas: tuple[str, ...]
    duration_s: float
    n_frames: int
    n_objects: int
    n_sightings: int
    files: tuple[Path, ...]


def simulate(
    folder: Path | str,
    *,
    name: str = "urban",
    speed_kmh: float | None = None,
    seed: int = 0,
    antennas: int = MOST_ANTENNAS,
    cameras: Sequence[str] = (),
    progress: Callable[[str], None] | None = None,
) -> SimulateReport:
    """Simulate a drive and write it as a DriveWorks trip, with its truth and its sources of error.

    The same arguments give the same bytes. The folder appears when it is complete, or not at all.

    Parameters
    ----------
    folder : Path or str
        Must not exist, or be empty.
    name : str
        One of `geoloc.simulation.simulate.SCENARIOS`.
    speed_kmh : float, optional
        Default: the scenario's own.
    seed : int
        Draws the errors, and the places of the poles of ``urban`` and ``highway``.
    antennas : {2, 1}
        1: the left antenna alone was recorded.
    cameras : sequence of str
        Cameras that were annotated. Default: the scenario's own.

    Raises
    ------
    RefusedError
        The folder holds something, or cannot be written; nothing was.
    ConfigError
        No such camera, another number of antennas, or a negative seed.
    GeolocError
        No such scenario, or no such speed.
    """
    say = progress or (lambda _text: None)
    target = Path(folder)
    _refuse_if_used(target)
    if not 1 <= antennas <= MOST_ANTENNAS:
        raise ConfigError(f"The simulated car has 1 or {MOST_ANTENNAS} antennas, not {antennas}.")
    world = _world(name, speed_kmh, seed, cameras)
    say(f"simulating {name}")
    drive = _with_antennas(simulate_drive(world, seed), antennas)
    say(f"writing {target}")
    names = _write(drive, target)
    return SimulateReport(
        folder=target,
        scenario=name,
        speed_kmh=SCENARIOS[name][1] if speed_kmh is None else speed_kmh,
        seed=seed,
        cameras=world.cameras,
        antennas=tuple(drive.rig.antennas),
        duration_s=world.motion.duration_s,
        n_frames=drive.frame_epoch_ns.size,
        n_objects=drive.objects.object.size,
        n_sightings=drive.sightings.frame.size,
        files=tuple(target / file for file in names),
    )


def noise_sources(spec: NoiseSpec) -> list[tuple[str, float, str]]:
    """List every source of error: its name with the unit, its value, and what stands behind it.

    The reasons are the texts below each field in `geoloc.simulation.noise.NoiseSpec`: told in one place.
    """
    source = ast.parse(inspect.getsource(NoiseSpec))
    body = next(node for node in source.body if isinstance(node, ast.ClassDef)).body
    sources = []
    for field, text in pairwise(body):
        if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
            continue
        if not (isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)):
            continue
        reason = " ".join(str(text.value.value).split())
        sources.append((field.target.id, float(getattr(spec, field.target.id)), reason))
    return sources


def _refuse_if_used(target: Path) -> None:
    try:
        used = target.is_dir() and any(target.iterdir())
    except OSError as error:
        raise RefusedError(
            f"{target} cannot be read ({error.strerror or error}): name a new folder for the simulated drive."
        ) from error
    if used:
        raise RefusedError(f"{target} is not empty: name a new folder for the simulated drive.")
    if target.is_file():
        raise RefusedError(f"{target} is a file: name a folder for the simulated drive.")


def _world(name: str, speed_kmh: float | None, seed: int, cameras: Sequence[str]) -> Scenario:
    if seed < 0:
        raise ConfigError(f"The seed is {seed}: give a whole number from 0 on.")
    unknown = [camera for camera in cameras if camera not in CAMERAS]
    if unknown:
        raise ConfigError(
            f"The simulated car has no camera {', '.join(unknown)}: choose among {', '.join(CAMERAS)}."
        )
    if name == "still" and speed_kmh is not None:
        raise ConfigError("The scenario still drives up at a speed of its own: leave --speed out.")
    world = scenario(name, speed_kmh, seed)
    # In the rig's order and each once, however they were asked for.
    return replace(world, cameras=tuple(c for c in CAMERAS if c in cameras)) if cameras else world


def _with_antennas(drive: SimulatedDrive, count: int) -> SimulatedDrive:
    """Keep the first `count` antennas, in the recording and in the rig file."""
    kept = {fixes.antenna: drive.rig.antennas[fixes.antenna] for fixes in drive.gnss[:count]}
    return replace(drive, gnss=drive.gnss[:count], rig=replace(drive.rig, antennas=kept))


def _write(drive: SimulatedDrive, target: Path) -> list[str]:
    """Write everything beside the target, then rename it; return the names of the files."""
    parent = make_folder(target.absolute().parent)
    try:
        with tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=parent) as private:
            # A folder in the private one: it gets the permissions that people expect.
            staging = Path(private) / "drive"
            files = write_driveworks_trip(drive, staging)
            for name, text in ((TRUTH, _truth(drive)), (NOTES, _notes(drive))):
                (staging / name).write_bytes(text.encode("utf-8"))
                files.append(staging / name)
            if target.is_dir():
                target.rmdir()
            shutil.move(staging, target)
    except OSError as error:
        raise RefusedError(
            f"The simulated drive cannot be written to {target} ({error.strerror or error}): name a folder "
            "that this user may write to."
        ) from error
    return [file.name for file in files]


def _truth(drive: SimulatedDrive) -> str:
    """CSV as ``twin evaluate`` reads it."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(("object", "label", "easting", "northing", "height"))
    objects = drive.objects
    feet = (objects.east_utm33_m, objects.north_utm33_m, objects.height_m)
    for name, *foot in zip(objects.object, *feet, strict=True):
        out.writerow((str(name), LABEL, *(f"{metres:.3f}" for metres in foot)))
    return text.getvalue()


def _notes(drive: SimulatedDrive) -> str:
    """Say in Markdown how the drive was made, every source of error, and what was drawn once."""
    world = drive.scenario
    made = (
        f"{world.motion.duration_s:.1f} s, {drive.objects.object.size} poles, annotated in "
        f"{', '.join(world.cameras)} every {world.annotate_every} frames between {world.range_m[0]:g} and "
        f"{world.range_m[1]:g} m. `{TRUTH}` has the true feet of the poles, EPSG:25833."
    )
    lines = [
        f"# A simulated drive: {world.name}, seed {drive.seed}",
        f"Made by `twin simulate` {__version__}. Nothing here was measured.",
        "",
        made,
        "",
        "## Sources of error",
        *(line.strip() for line in inspect.cleandoc(NoiseSpec.__doc__ or "").splitlines()),
        "",
        *_table(
            ("source", "value", "why"),
            [(f"`{n}`", f"{v:g}", why) for n, v, why in noise_sources(world.noise)],
        ),
        "",
        "## Drawn once for this drive",
        "What the rig file and the stamps do not say: the true car minus the stated one.",
        "",
        *_table(("what", "value"), _drawn(drive)),
    ]
    return "\n".join(lines) + "\n"


def _drawn(drive: SimulatedDrive) -> list[tuple[str, str]]:
    def vector(values: NDArray[np.float64]) -> str:
        return " ".join(f"{value:+.4f}" for value in values)

    drawn = drive.drawn
    rows = [
        ("frame stamps late, ms", f"{drawn.frame_offset_ms:+.3f}"),
        ("slip of the rear axle, deg per m/s²", f"{drawn.slip_deg_per_mps2:.3f}"),
    ]
    for camera in drive.scenario.cameras:
        rows += [
            (f"{camera}: boresight about the rig's x y z, deg", vector(drawn.boresight_deg[camera])),
            (f"{camera}: position x y z, m", vector(drawn.camera_position_m[camera])),
            (f"{camera}: focal length, relative", f"{drawn.focal_relative[camera]:+.6f}"),
            (f"{camera}: principal point x y, px", vector(drawn.principal_point_px[camera])),
        ]
    return rows + [
        (f"{name}: lever arm x y z, m", vector(drawn.lever_arm_m[name])) for name in drive.rig.antennas
    ]


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table."""
    cells = [header, ["---"] * len(header), *rows]
    return [f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in cells]
