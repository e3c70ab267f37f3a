"""The body of ``twin sync-nvdb``."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin.cli.output import bar, log_notes, note, print_json, print_pairs, warn

if TYPE_CHECKING:
    from nvdb.area import Area
    from twin.mirror.sync import SyncResult


def sync_nvdb(
    area: Area,
    source: str,
    api_url: str,
    contact: str | None,
    replace: bool,
    fresh: bool,
    confirm_deletions: bool,
    vegnett: bool,
    store: Path,
    json_output: bool,
) -> None:
    """``twin sync-nvdb``."""
    from twin.mirror import sync
    from twin.store.store import Store

    asked: Any = {"api_url": api_url, "contact": contact, "confirm_deletions": confirm_deletions}
    how: Any = {"source": source, "replace": replace, "fresh": fresh}
    # A store is kept also if the sync fails: a backfill goes on where it stopped.
    with Store.open(store) as opened, log_notes("nvdb", quiet=json_output):
        with bar(quiet=json_output) as progress:
            result = sync.sync_nvdb(opened, area, progress=progress, **how, **asked)
        # Before the network is asked for: what the signs' sync did is not hidden by what comes after it.
        _print_sync(result, json_output)
        if vegnett:
            try:
                with bar(quiet=json_output) as progress:
                    sync.sync_roads(opened, area, progress=progress, **asked)
            except BaseException:
                note("The signs are synced and kept; the road network is not yet.")
                raise


def _print_sync(result: SyncResult, json_output: bool) -> None:
    if json_output:
        print_json(result)
        return
    print_pairs(f"NVDB: {result.area}", _sync_pairs(result))
    if not result.skiltpunkt and not result.skiltplate:
        warn(f"NVDB has no sign in {result.area}: check the area, and name the right one with --replace.")
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


def sync_dry_run(
    area: Area,
    source: str,
    api_url: str,
    contact: str | None,
    json_output: bool,
    store: Path | None = None,
    replace: bool = False,
    fresh: bool = False,
) -> None:
    """``twin sync-nvdb --dry-run``; makes no store where there is none."""
    from twin.mirror.sync import dry_run
    from twin.store.store import Store

    known = Store.open(store, create=False) if store is not None and store.exists() else nullcontext()
    with known as opened, log_notes("nvdb", quiet=json_output):
        how: Any = {"source": source, "replace": replace, "fresh": fresh}
        found = dry_run(area, store=opened, api_url=api_url, contact=contact, **how)
    if json_output:
        print_json(found)
        return
    counts = {"Skiltpunkt": found["expected"][95], "Skiltplate": found["expected"][96]}
    print_pairs(_WOULD[found["mode"]].format(**found), {**counts, "first question": found["first_url"]})
    if set(counts.values()) == {0}:
        warn(f"NVDB has no sign in {found['area']}: check the area.")


_WOULD = {
    "backfill": "Would mirror {area}",
    "resumed": "Would go on with the interrupted backfill of {area}",
    "changes": "Would follow the changes of {area} since {position}",
}
