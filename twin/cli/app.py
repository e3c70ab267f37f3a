"""The commands of ``twin``."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from twin.cli import calibrate_rig, qgis
from twin.cli.options import (
    DEFAULT_API,
    DEFAULT_SKRIV_API,
    DEFAULT_STORE,
    ByOption,
    DecisionName,
    FindingVerdict,
    JsonOption,
    Method,
    PairBy,
    Realm,
    ScenarioName,
    SetDecision,
    SourceName,
    StoreOption,
)

app = typer.Typer(
    name="twin",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Keep the road-sign layer of Norway's digital twin true: "
    "a recorded drive and NVDB in, change sets for QGIS and the road database out.",
    epilog="Order of work: sync-nvdb, ingest-drive, match, export.  Try it all on the sample: twin demo",
)


def _version(show: bool) -> None:
    if show:
        from twin import __version__

        typer.echo(f"twin {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    """Take what holds for every command."""


@app.command("sync-nvdb", epilog="Example: twin sync-nvdb --kommune 5001 --contact me@example.no")
def sync_nvdb(
    kommune: Annotated[
        str | None, typer.Option(help="Municipality numbers, separated by commas: 5001,5031.")
    ] = None,
    fylke: Annotated[str | None, typer.Option(help="County numbers, separated by commas: 50,15.")] = None,
    kontraktsomrade: Annotated[
        str | None,
        typer.Option(help="Contract areas, names as in NVDB or ids: '9503 Midtre Hålogaland 2021-2026'."),
    ] = None,
    bbox: Annotated[
        str | None, typer.Option(help="minE,minN,maxE,maxN in UTM33 (EPSG:25833), metres.")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="The whole country.")] = False,
    source: Annotated[
        SourceName, typer.Option(help="Which API to mirror: Les V4, or Uberiket (country or box).")
    ] = SourceName.LES_V4,
    api_url: Annotated[
        str, typer.Option(envvar="TWIN_API_URL", help="Address of NVDB's APIs.")
    ] = DEFAULT_API,
    contact: Annotated[
        str | None,
        typer.Option(
            envvar="TWIN_CONTACT", help="Your e-mail address, sent along so that NVDB can reach you."
        ),
    ] = None,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace a mirror of another area in this store.")
    ] = False,
    fresh: Annotated[bool, typer.Option("--fresh", help="Fetch everything, not only the changes.")] = False,
    confirm_deletions: Annotated[
        bool, typer.Option("--confirm-deletions", help="Allow more than 5 % of the mirror to be deleted.")
    ] = False,
    vegnett: Annotated[
        bool, typer.Option("--vegnett", help="Also fetch the road network, for stedfesting and facing.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say what would be asked, and how many objects there are.")
    ] = False,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Mirror NVDB's signs: Skiltpunkt (95) and Skiltplate (96) of an area, into the store.

    The first run names an area and fetches everything; later ones know it and fetch only what changed. One
    that was interrupted goes on where it stopped.
    """
    from twin.cli import sync
    from twin.mirror.sync import area_from_options

    area = area_from_options(
        store,
        kommune=kommune,
        fylke=fylke,
        kontraktsomrade=kontraktsomrade,
        bbox=bbox,
        everything=everything,
    )
    if dry_run:
        sync.sync_dry_run(
            area, source.value, api_url, contact, json_output, store=store, replace=replace, fresh=fresh
        )
        return
    sync.sync_nvdb(
        area, source.value, api_url, contact, replace, fresh, confirm_deletions, vegnett, store, json_output
    )


@app.command("ingest-drive", epilog="Example: twin ingest-drive data/trip_trondheim")
def ingest_drive(
    drive: Annotated[Path, typer.Argument(help="The drive's folder.", metavar="DRIVE")],
    method: Annotated[
        Method,
        typer.Option(
            help="adjusted: all sightings together. single-frame: each by itself. paper: the baseline."
        ),
    ] = Method.ADJUSTED,
    terrain: Annotated[
        Path | None, typer.Option(help="Ground raster (GeoTIFF) instead of the plane of the road.")
    ] = None,
    terrain_heights: Annotated[
        str | None, typer.Option(help="NN2000 or ellipsoidal, where the raster does not say.")
    ] = None,
    labels: Annotated[
        Path | None, typer.Option(help="What labels mean, instead of the drive's labels.toml.")
    ] = None,
    detector: Annotated[
        Path | None, typer.Option(help="Find the signs by this network (ONNX) instead of annotations.")
    ] = None,
    detector_every: Annotated[int, typer.Option(min=1, help="Run the detector on every so many frames.")] = 1,
    detector_threshold: Annotated[
        float, typer.Option(help="Lowest score of a box that counts, between 0 and 1.")
    ] = 0.25,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Locate what was annotated in a recorded drive, and keep it in the store."""
    from twin.cli import commands

    commands.ingest_drive(
        drive,
        method,
        terrain,
        terrain_heights,
        store,
        json_output,
        labels=labels,
        detector=None if detector is None else (detector, detector_every, detector_threshold),
    )


@app.command("inspect", epilog="Example: twin inspect path/to/trip --out timeline.png")
def inspect(
    drive: Annotated[Path, typer.Argument(help="A folder with a recorded drive.", metavar="DRIVE")],
    out: Annotated[Path | None, typer.Option(help="PNG of all sensors on one timeline.")] = None,
    json_output: JsonOption = False,
) -> None:
    """Show what a drive folder holds: files, sensors on one timeline, gaps, delays, and what is missing."""
    from twin.cli import inspect as body

    body.inspect(drive, out, json_output)


@app.command("match", epilog="Example: twin match")
def match(
    method: Annotated[
        Method | None, typer.Option(help="Whose estimates to match. Default: the best in the store.")
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="Metres from NVDB's position beyond which a sign has moved.")
    ] = 1.0,
    exit_code: Annotated[
        bool, typer.Option("--exit-code", help="Exit with 1 if findings are open, 0 if none is.")
    ] = False,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Compare the estimates with the mirror: new, missing, moved, wrong type, unchanged, or for review."""
    from twin.cli import findings

    findings.match(method, tolerance, exit_code, store, json_output)


@app.command("explain", epilog="Example: twin explain 3f09a1b2c4d5")
def explain(
    change: Annotated[
        str, typer.Argument(help="A finding's change_id, or its first six digits.", metavar="CHANGE_ID")
    ],
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Explain one finding: verdict, confidence and reason, and who decided what about it."""
    from twin.cli import findings

    findings.explain(change, store, json_output)


@app.command(
    "decide",
    epilog="Example: twin decide dismiss 3f09a1b2c4d5 --reason 'road works'.  In bulk: twin decide accept "
    "--verdict new --class 362 --since 2026-06-01.  From QGIS: twin decide --from out/twin_utm33.gpkg.  "
    "Back: twin decide undo",
)
def decide(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            help="accept, dismiss, defer or open, and change ids (or their first six digits); or undo, and "
            "how many commands.",
            metavar="CHANGE_ID… DECISION",
            show_default=False,
        ),
    ] = None,
    verdict: Annotated[list[FindingVerdict] | None, typer.Option(help="Findings of this verdict.")] = None,
    drive: Annotated[list[str] | None, typer.Option(help="Findings of this drive: its id or name.")] = None,
    area: Annotated[Path | None, typer.Option(help="Findings inside the polygons of a GeoJSON file.")] = None,
    sign_class: Annotated[
        list[str] | None, typer.Option("--class", help="Sign code seen or in NVDB: 362.50, or 362 for all.")
    ] = None,
    since: Annotated[
        datetime | None, typer.Option(formats=["%Y-%m-%d"], help="Findings of drives since this day (UTC).")
    ] = None,
    until: Annotated[
        datetime | None, typer.Option(formats=["%Y-%m-%d"], help="Findings of drives until this day (UTC).")
    ] = None,
    state: Annotated[
        DecisionName, typer.Option(help="Select among findings that are now so decided.")
    ] = DecisionName.OPEN,
    from_file: Annotated[
        Path | None, typer.Option("--from", help="Take the decisions made in QGIS in an exported GeoPackage.")
    ] = None,
    reason: Annotated[str, typer.Option(help="Why; kept with the decision.")] = "",
    by: ByOption = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only say which findings would be decided.")
    ] = False,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Decide about findings: one by one, in bulk, or as decided in QGIS. Undo takes the last command back.

    A decision holds until what it rests on really changes; then the finding is open again and says why.
    """
    from twin.cli import findings
    from twin.decisions.findings import Selection

    wanted = Selection(
        drives=tuple(drive or ()),
        area=area,
        verdicts=tuple(verdict or ()),
        classes=tuple(sign_class or ()),
        since=since.date() if since else None,
        until=until.date() if until else None,
        decision=state.value,
    )
    findings.decide(words or (), wanted, from_file, reason, by, dry_run, store, json_output)


@app.command("export", epilog="Example: twin export out  (then twin qgis out)")
def export(
    folder: Annotated[Path, typer.Argument(help="Where to write; made if it does not exist.", metavar="DIR")],
    by: ByOption = None,
    decision: Annotated[
        SetDecision, typer.Option(help="accept: change sets to send. open: previews, of what is undecided.")
    ] = SetDecision.ACCEPT,
    project: Annotated[
        bool, typer.Option("--project", help="With a QGIS project in twin_utm33.gpkg: see twin qgis.")
    ] = False,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Write the findings as GeoPackages (UTM33 and WGS84, styled for QGIS) and GeoJSON.

    Accepted findings are also written as change sets for API Skriv: see twin submit.
    """
    from twin.cli import commands

    commands.export(folder, by, store, json_output, decision=decision.value, project=project)


app.command("qgis", epilog="Example: twin qgis out   with QGIS started: twin qgis out --open")(qgis.qgis)


@app.command("submit", epilog="Example: twin submit out  (checks only)   then: twin submit out --go")
def submit(
    path: Annotated[
        Path, typer.Argument(help="An export's folder, or one change set.", metavar="FOLDER|FILE")
    ],
    go: Annotated[
        bool, typer.Option("--go", help="Send and start them; without it they are checked.")
    ] = False,
    api_url: Annotated[
        str, typer.Option(envvar="TWIN_SKRIV_URL", help="API Skriv; by default its test environment.")
    ] = DEFAULT_SKRIV_API,
    user: Annotated[
        str | None,
        typer.Option(envvar="TWIN_SKRIV_USER", help="User name; the password is TWIN_SKRIV_PASSWORD's."),
    ] = None,
    realm: Annotated[
        Realm, typer.Option(envvar="TWIN_SKRIV_REALM", help="What kind of user that is.")
    ] = Realm.EMPLOYEE,
    wait: Annotated[float, typer.Option(min=0, help="Longest wait for one set.", metavar="SECONDS")] = 3600.0,
    json_output: JsonOption = False,
) -> None:
    """Check the change sets of an export; with --go send them to NVDB's API Skriv and report each object."""
    from twin.cli import submit as body

    body.submit(path, go, api_url, user, realm.value, wait, json_output)


@app.command("evaluate", epilog="Example: twin evaluate data/truth.csv --plots plots")
def evaluate(
    truth: Annotated[
        Path,
        typer.Argument(help="CSV with object,label,easting,northing in EPSG:25833.", metavar="TRUTH.csv"),
    ],
    by: Annotated[
        PairBy,
        typer.Option(help="How estimates find their truth: auto takes the ids, or positions if no id fits."),
    ] = PairBy.AUTO,
    within: Annotated[
        float, typer.Option(min=0, help="By position: nothing farther apart is paired.", metavar="METRES")
    ] = 5.0,
    plots: Annotated[
        Path | None, typer.Option(help="Folder for the figures error–distance and error–speed.")
    ] = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Compare the estimates of every method with surveyed positions."""
    from twin.cli import commands

    commands.evaluate(truth, by.value, within, plots, store, json_output)


@app.command("show", epilog="Example: twin show P01 --out P01.png")
def show(
    estimate: Annotated[
        str,
        typer.Argument(
            help="An estimate's id, or an object's where only one drive has it.", metavar="ESTIMATE"
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Also draw it: a PNG.", metavar="FILE.png")] = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Explain one estimate: its position, what its error comes from, the frames that it rests on."""
    from twin.cli.show import show as run

    run(estimate, out, store, json_output)


@app.command("status", epilog="Example: twin status")
def status(store: StoreOption = DEFAULT_STORE, json_output: JsonOption = False) -> None:
    """Say what the store holds: the mirror and its age, drives, estimates, findings."""
    from twin.cli import commands

    commands.status(store, json_output)


@app.command("simulate", epilog="Example: twin simulate trial --scenario highway --speed 80 --seed 7")
def simulate(
    out: Annotated[
        Path, typer.Argument(help="Where to write the drive: a new or an empty folder.", metavar="OUT")
    ],
    scenario: Annotated[
        ScenarioName,
        typer.Option(
            help="still: the paper's standing car. approach: towards one pole. urban, highway: many poles. "
            "sample: the road of the shipped sample."
        ),
    ] = ScenarioName.URBAN,
    speed: Annotated[
        float | None,
        typer.Option(
            min=1.0, max=130.0, help="km/h, not for still; default: the scenario's own.", metavar="KMH"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Draws all errors; the same seed, the same drive.")] = 0,
    antennas: Annotated[int, typer.Option(min=1, max=2, help="GNSS antennas that were recorded.")] = 2,
    cameras: Annotated[
        str | None,
        typer.Option(
            help="Cameras that were annotated, separated by commas: C2_tricam60,C3_tricam120; "
            "default: the scenario's own."
        ),
    ] = None,
    json_output: JsonOption = False,
) -> None:
    """Write a simulated drive for ingest-drive, with its truth for evaluate and every source of error."""
    from twin.cli import commands

    commands.simulate(out, scenario.value, speed, seed, antennas, cameras, json_output)


app.add_typer(calibrate_rig.app)


@app.command("demo", epilog="Example: twin demo --out demo-out")
def demo(
    out: Annotated[Path, typer.Option(help="Where the demo writes its store and layers.")] = Path("demo-out"),
    json_output: JsonOption = False,
) -> None:
    """Run the whole job on the shipped sample: a simulated drive near Trondheim and an NVDB around it."""
    from twin.cli import commands

    commands.demo(out, json_output)
