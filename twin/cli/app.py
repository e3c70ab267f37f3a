"""The commands of ``twin``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

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

StoreOption = Annotated[
    Path, typer.Option("--store", envvar="TWIN_STORE", help="The store, one SQLite file.", show_default=True)
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on stdout instead of tables.")
]


class Method(StrEnum):
    """Geolocation methods, as in :data:`twin.match.METHODS`."""

    SINGLE_FRAME = "single-frame"
    PAPER = "paper"


class SourceName(StrEnum):
    """APIs that a mirror can follow, as in :data:`twin.sync.SOURCES`."""

    LES_V4 = "les-v4"
    UBERIKET = "uberiket"


DEFAULT_STORE = Path("twin.db")
DEFAULT_API = "https://nvdbapiles.atlas.vegvesen.no"


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
    bbox: Annotated[
        str | None, typer.Option(help="minE,minN,maxE,maxN in UTM33 (EPSG:25833), metres.")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="The whole country.")] = False,
    source: Annotated[
        SourceName, typer.Option(help="Which API to mirror: Les V4, or Uberiket (country or box only).")
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

    The first run fetches everything, later ones only what changed. One that was interrupted goes on where it
    stopped.
    """
    from twin.cli import commands

    area = (kommune, bbox, everything)
    if dry_run:
        commands.sync_dry_run(area, source.value, api_url, contact, json_output)
        return
    commands.sync_nvdb(
        area, source.value, api_url, contact, replace, fresh, confirm_deletions, vegnett, store, json_output
    )


@app.command("ingest-drive", epilog="Example: twin ingest-drive data/trip_trondheim")
def ingest_drive(
    drive: Annotated[Path, typer.Argument(help="The drive's folder.", metavar="DRIVE")],
    method: Annotated[
        Method, typer.Option(help="single-frame: the true ray. paper: the baseline, to the letter.")
    ] = Method.SINGLE_FRAME,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Locate what was annotated in a recorded drive, and keep it in the store."""
    from twin.cli import commands

    commands.ingest_drive(drive, method, store, json_output)


@app.command("match", epilog="Example: twin match")
def match(
    method: Annotated[
        Method | None, typer.Option(help="Whose estimates to match.  [default: the best in the store]")
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="Metres from NVDB's position beyond which a sign has moved.")
    ] = 1.0,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Compare the estimates with the mirror: new, missing, moved, wrong type, unchanged, or for review."""
    from twin.cli import commands

    commands.match(method, tolerance, store, json_output)


@app.command("export", epilog="Example: twin export out  (then open out/twin_utm33.gpkg in QGIS)")
def export(
    folder: Annotated[Path, typer.Argument(help="Where to write; made if it does not exist.", metavar="DIR")],
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Write the findings as GeoPackages (UTM33 and WGS84, styled for QGIS) and GeoJSON."""
    from twin.cli import commands

    commands.export(folder, store, json_output)


@app.command("evaluate", epilog="Example: twin evaluate data/truth.csv --plots plots")
def evaluate(
    truth: Annotated[
        Path,
        typer.Argument(help="CSV with object,label,easting,northing in EPSG:25833.", metavar="TRUTH.csv"),
    ],
    plots: Annotated[
        Path | None, typer.Option(help="Folder for the figures error–distance and error–speed.")
    ] = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Compare the estimates of every method with surveyed positions."""
    from twin.cli import commands

    commands.evaluate(truth, plots, store, json_output)


@app.command("status", epilog="Example: twin status")
def status(store: StoreOption = DEFAULT_STORE, json_output: JsonOption = False) -> None:
    """Say what the store holds: the mirror and its age, drives, estimates, findings."""
    from twin.cli import commands

    commands.status(store, json_output)


@app.command("demo", epilog="Example: twin demo --out demo-out")
def demo(
    out: Annotated[Path, typer.Option(help="Where the demo writes its store and layers.")] = Path("demo-out"),
    json_output: JsonOption = False,
) -> None:
    """Run the whole job on the shipped sample: a simulated drive near Trondheim and an NVDB around it."""
    from twin.cli import commands

    commands.demo(out, json_output)
