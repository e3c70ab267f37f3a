"""``twin sync-nvdb``: the mirror of NVDB."""

from __future__ import annotations

import gc
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.journal import manner
from twin.cli.made_store import made_store
from twin.cli.options import DEFAULT_STORE, ContactOption, JsonOption, StoreOption
from twin.cli.output import bar, note, print_json, print_line, print_pairs, warn
from twin.store.address import StoreAddress

if TYPE_CHECKING:
    from nvdb.area import Area
    from twin.mirror.sync import SyncPlan, SyncResult
    from twin.store.store import Store

app = typer.Typer()
COLLECT_AFTER = (100_000, 20, 50)
"""Thresholds of the garbage collector. A page of NVDB is some 100,000 containers, which live until it is
stored and then go by their reference counts: to look through them for circles at every 700 is for nothing.
"""

DEFAULT_API = "https://nvdbapiles.atlas.vegvesen.no"


class SourceName(StrEnum):
    """APIs that a mirror can follow."""

    LES_V4 = "les-v4"
    UBERIKET = "uberiket"


KommuneOption = Annotated[
    str | None,
    typer.Option(envvar="TWIN_KOMMUNE", help="Municipality numbers: 5001,5031, or the option again."),
]
FylkeOption = Annotated[
    str | None, typer.Option(envvar="TWIN_FYLKE", help="County numbers: 50,15, or the option again.")
]
KontraktsomradeOption = Annotated[
    str | None,
    typer.Option(
        envvar="TWIN_KONTRAKTSOMRADE",
        help="Contract areas, names as in NVDB or ids: '9503 Midtre Hålogaland 2021-2026'.",
    ),
]
BboxOption = Annotated[
    str | None, typer.Option(envvar="TWIN_BBOX", help="minE,minN,maxE,maxN in UTM33 (EPSG:25833), metres.")
]
EverythingOption = Annotated[bool, typer.Option("--all", help="The whole country.")]
SourceOption = Annotated[
    SourceName,
    typer.Option(envvar="TWIN_SOURCE", help="Which API to mirror: Les V4, or Uberiket (country or box)."),
]
ApiOption = Annotated[str, typer.Option(envvar="TWIN_API_URL", help="Address of NVDB's APIs.")]
ReplaceOption = Annotated[
    bool, typer.Option("--replace", help="Replace a mirror of another area in this store.")
]
FreshOption = Annotated[bool, typer.Option("--fresh", help="Fetch everything, not only the changes.")]
ConfirmDeletionsOption = Annotated[
    bool, typer.Option("--confirm-deletions", help="Allow more than 5 % of the mirror to be deleted.")
]
VegnettOption = Annotated[
    bool,
    typer.Option(
        "--vegnett/--no-vegnett",
        envvar="TWIN_VEGNETT",
        help="Also fetch the road network, for stedfesting and facing.",
    ),
]
DryRunOption = Annotated[
    bool, typer.Option("--dry-run", help="Only say what would be asked, and how many objects there are.")
]


@app.command("sync-nvdb", epilog="Example: twin sync-nvdb --kommune 5001 --contact me@example.no")
def sync_nvdb(
    kommune: KommuneOption = None,
    fylke: FylkeOption = None,
    kontraktsomrade: KontraktsomradeOption = None,
    bbox: BboxOption = None,
    everything: EverythingOption = False,
    source: SourceOption = SourceName.LES_V4,
    api_url: ApiOption = DEFAULT_API,
    contact: ContactOption = None,
    replace: ReplaceOption = False,
    fresh: FreshOption = False,
    confirm_deletions: ConfirmDeletionsOption = False,
    vegnett: VegnettOption = False,
    dry_run: DryRunOption = False,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Mirror NVDB's signs: Skiltpunkt (95) and Skiltplate (96) of an area, into the store.

    The first run names an area and fetches everything; later ones know it and fetch only what changed. One
    that was interrupted goes on where it stopped.
    """
    from twin.mirror.sync import area_from_options

    gc.set_threshold(*COLLECT_AFTER)
    area = area_from_options(
        store,
        kommune=kommune,
        fylke=fylke,
        kontraktsomrade=kontraktsomrade,
        bbox=bbox,
        everything=everything,
    )
    order = _Order(area, source, api_url, contact, replace, fresh, confirm_deletions, quiet=json_output)
    if dry_run:
        _print_plan(_planned(order, store), json_output)
        return
    with made_store(store) as opened:
        result = _synced(order, opened)
        # Before the network is asked for: what the signs' sync did is not hidden by what comes after it.
        _print_sync(result, json_output)
        if vegnett:
            _sync_roads(order, opened)


@dataclass(frozen=True, slots=True)
class _Order:
    """What to mirror, from where and how, as the options say; `quiet`: without progress."""

    area: Area
    source: SourceName
    api_url: str
    contact: str | None
    replace: bool
    fresh: bool
    confirm_deletions: bool
    quiet: bool


def _planned(order: _Order, store: StoreAddress) -> SyncPlan:
    """What a sync would do; makes no store."""
    from twin.mirror import sync
    from twin.store.store import Store

    existing = Store.open(store, create=False) if Store.exists(store) else nullcontext()
    with existing as opened:
        return sync.dry_run(
            order.area,
            store=opened,
            api_url=order.api_url,
            source=order.source,
            contact=order.contact,
            replace=order.replace,
            fresh=order.fresh,
        )


def _synced(order: _Order, store: Store) -> SyncResult:
    from twin.mirror import sync

    with bar(quiet=order.quiet) as progress:
        return sync.sync_nvdb(
            store,
            order.area,
            api_url=order.api_url,
            source=order.source,
            contact=order.contact,
            replace=order.replace,
            fresh=order.fresh,
            confirm_deletions=order.confirm_deletions,
            progress=progress,
        )


def _sync_roads(order: _Order, store: Store) -> None:
    from twin.mirror import sync

    try:
        with bar(quiet=order.quiet) as progress:
            sync.sync_roads(
                store,
                order.area,
                api_url=order.api_url,
                contact=order.contact,
                confirm_deletions=order.confirm_deletions,
                progress=progress,
            )
    except BaseException:
        note("The signs are synced and kept; the road network is not yet.")
        raise


def _print_sync(result: SyncResult, json_output: bool) -> None:
    if json_output:
        print_json(result)
        return
    if not manner.quiet:
        print_pairs(f"NVDB: {result.area}", _sync_pairs(result))
    elif result.created or result.changed or result.deleted:
        numbers = f"{result.created:,} new, {result.changed:,} changed, {result.deleted:,} deleted"
        print_line(f"NVDB, {result.area}: {numbers}")
    if not result.skiltpunkt and not result.skiltplate:
        warn(f"NVDB has no sign in {result.area}: check the area.")
    for news in result.datakatalog_news[:10]:
        note(f"datakatalog: {news}")
    for problem in result.problems[:10]:
        warn(problem)
    if result.n_problems > 10:
        note(f"… and {result.n_problems - 10} more; --json lists the first 100.")


def _sync_pairs(result: SyncResult) -> dict[str, object]:
    def held(number: int, expected: int | None) -> str:
        return f"{number:,}" if expected is None else f"{number:,} (NVDB counts {expected:,})"

    events = {"events since the last sync": result.n_events} if result.mode == "changes" else {}
    return {
        "Skiltpunkt": held(result.skiltpunkt, result.expected.get(95)),
        "Skiltplate": held(result.skiltplate, result.expected.get(96)),
        **events,
        "new / changed / deleted": f"{result.created:,} / {result.changed:,} / {result.deleted:,}",
        "without own geometry": result.without_own_geometry,
        "stated accuracy": _tally({_centimetres(key): n for key, n in result.by_accuracy.items()}),
        "capture method": _tally(result.by_capture_method),
        "unknown to the datakatalog": _tally(result.unknown),
        "problems": result.n_problems,
        "how": _HOW[result.mode],
        "source": f"{result.source} at {result.url}, datakatalog {result.datakatalog}",
    }


def _centimetres(text: str) -> str:
    """``100.0`` → ``100 cm``; what is no number stays as it is."""
    return f"{float(text):g} cm" if text.replace(".", "", 1).isdigit() else text


_HOW = {
    "backfill": "everything fetched",
    "resumed": "the rest of an interrupted backfill fetched",
    "changes": "changes fetched",
}
_MAX_SHOWN = 6
"""Values that a tally shows; --json has them all."""


def _tally(numbers: Mapping[str, int]) -> str | None:
    shown = [f"{value}: {n:,}" for value, n in list(numbers.items())[:_MAX_SHOWN]]
    return "  ".join(shown + ["…"] * (len(numbers) > _MAX_SHOWN)) or None


def _print_plan(plan: SyncPlan, json_output: bool) -> None:
    if json_output:
        print_json(plan)
        return
    counts = {"Skiltpunkt": plan.expected[95], "Skiltplate": plan.expected[96]}
    would = _WOULD[plan.mode].format(area=plan.area, position=plan.position)
    print_pairs(would, {**counts, "first question": plan.first_url})
    if set(counts.values()) == {0}:
        warn(f"NVDB has no sign in {plan.area}: check the area.")


_WOULD = {
    "backfill": "Would mirror {area}",
    "resumed": "Would go on with the interrupted backfill of {area}",
    "changes": "Would follow the changes of {area} since {position}",
}
