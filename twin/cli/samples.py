"""``twin simulate`` and ``twin demo``: drives that nobody drove."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import JsonOption
from twin.cli.output import note, print_json, print_pairs, print_paths, print_table, steps
from twin.errors import to_type

if TYPE_CHECKING:
    from twin.samples.simulation import SimulateReport

app = typer.Typer()


class ScenarioName(StrEnum):
    """Worlds to simulate, as in :data:`geoloc.simulation.simulate.SCENARIOS`."""

    SAMPLE = "sample"
    STILL = "still"
    APPROACH = "approach"
    URBAN = "urban"
    HIGHWAY = "highway"


ScenarioOption = Annotated[
    ScenarioName,
    typer.Option(
        help="still: the paper's standing car. approach: towards one pole. urban, highway: many poles. "
        "sample: the road of the shipped sample."
    ),
]
SpeedOption = Annotated[
    float | None,
    typer.Option(min=1.0, max=130.0, help="km/h, not for still; default: the scenario's own.", metavar="KMH"),
]
SeedOption = Annotated[int, typer.Option(min=0, help="Draws all errors; the same seed, the same drive.")]
AntennasOption = Annotated[int, typer.Option(min=1, max=2, help="GNSS antennas that were recorded.")]
CamerasOption = Annotated[
    str | None,
    typer.Option(
        help="Cameras that were annotated, separated by commas: C2_tricam60,C3_tricam120; "
        "default: the scenario's own."
    ),
]


@app.command("simulate", epilog="Example: twin simulate trial --scenario highway --speed 80 --seed 7")
def simulate(
    out: Annotated[
        Path, typer.Argument(help="Where to write the drive: a new or an empty folder.", metavar="OUT")
    ],
    scenario: ScenarioOption = ScenarioName.URBAN,
    speed: SpeedOption = None,
    seed: SeedOption = 0,
    antennas: AntennasOption = 2,
    cameras: CamerasOption = None,
    json_output: JsonOption = False,
) -> None:
    """Write a simulated drive for ingest-drive, with its truth for evaluate and every source of error."""
    from twin.samples.simulation import simulate as run

    names = tuple(name.strip() for name in (cameras or "").split(",") if name.strip())
    with steps(quiet=json_output) as progress:
        report = run(
            out,
            name=scenario.value,
            speed_kmh=speed,
            seed=seed,
            antennas=antennas,
            cameras=names,
            progress=progress,
        )
    if json_output:
        print_json(report)
        return
    _print_simulated(report)
    note(f"Next: {to_type('twin', 'ingest-drive', out)}, then twin evaluate {report.files[-2]}")


def _print_simulated(report: SimulateReport) -> None:
    print_pairs(
        f"Simulated drive {report.folder}",
        {
            "scenario": f"{report.scenario}, seed {report.seed}",
            "speed": None if report.scenario == "still" else f"{report.speed_kmh:g} km/h",
            "recorded": f"{report.duration_s:.1f} s, {report.n_frames:,} frames of each camera",
            "antennas": len(report.antennas),
            "annotated": ", ".join(report.cameras),
            "poles": report.n_objects,
            "sightings": report.n_sightings,
        },
    )
    print_paths("Written:", report.files)


@app.command("demo", epilog="Example: twin demo --out demo-out")
def demo(
    out: Annotated[Path, typer.Option(help="Where the demo writes its store and layers.")] = Path("demo-out"),
    json_output: JsonOption = False,
) -> None:
    """Run the whole job on the shipped sample: a simulated drive near Trondheim and an NVDB around it."""
    from twin.cli.reports import print_errors

    with steps(quiet=json_output) as progress:
        progress("starting a replay server that plays NVDB")  # before all of twin is loaded
        from twin.samples.demo import run_demo, summary

        report = run_demo(out, progress=progress)
    numbers = summary(report)
    if json_output:
        print_json(numbers)
        return
    expected = report.expected
    print_pairs(
        "The sample, end to end",
        {
            "signs synced": f"{numbers['signs_synced']['skiltpunkt']} Skiltpunkt, "
            f"{numbers['signs_synced']['skiltplate']} Skiltplate",
            "drives": f"{numbers['drives']}, with {numbers['pictures']} painted pictures",
            "sightings": numbers["sightings"],
            "estimates": numbers["estimates"],
            "findings with pictures": f"{report.evidence.n_with_crops} of {report.evidence.n_findings}, "
            f"{report.evidence.n_crops} crops",
        },
    )
    print_table(
        "Verdicts",
        ["verdict", "found", "made to be"],
        [(v, n, expected.get(v, 0)) for v, n in report.match.verdicts.items()],
    )
    print_errors(report.evaluation.methods)
    print_paths("Open these:", report.files)
    note(f"Decide: twin review --store {out / 'demo.db'}")
    note(f"In QGIS: {to_type('twin', 'qgis', out)} --open")
    note(f"Why a sign stands where it does: twin show P01 --store {out / 'demo.db'} --out P01.png")
