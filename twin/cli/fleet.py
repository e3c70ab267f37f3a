"""``twin fleet``: many drives, by many processes or machines, through the queue in the store."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.cli.drives import (
    DetectorEveryOption,
    DetectorOption,
    DetectorThresholdOption,
    ErrorOption,
    LabelsOption,
    MethodOption,
    PartialOption,
    ReplaceOption,
    TerrainHeightsOption,
    TerrainOption,
    stated_errors,
)
from twin.cli.exit_codes import EXIT_DATA
from twin.cli.made_store import made_store
from twin.cli.options import DEFAULT_STORE, JsonOption, StoreOption
from twin.cli.output import note, print_json, print_line, print_table, steps, warn
from twin.store.kinds import Fault, JobKind, JobState, Method

if TYPE_CHECKING:
    from twin.fleet import Executor, Job, Tally
    from twin.store.store import Store

app = typer.Typer()
_MOST_SHOWN = 40

WorkersOption = Annotated[
    int | None,
    typer.Option(
        min=1, help="Drives that are located at once on this machine.  [default: a core each]", metavar="N"
    ),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(help="Locate on a Dask cluster instead.", metavar="tcp://HOST:8786"),
]


@app.command("ingest", epilog="Example: twin fleet ingest 's3://drives/2026-06-*' --workers 2")
def ingest(
    drives: Annotated[
        list[str],
        typer.Argument(
            help="Folders, or URLs of shared or object storage; * stands for any part of a name.",
            metavar="DRIVE...",
        ),
    ],
    method: MethodOption = Method.ADJUSTED,
    terrain: TerrainOption = None,
    terrain_heights: TerrainHeightsOption = None,
    error: ErrorOption = None,
    labels: LabelsOption = None,
    detector: DetectorOption = None,
    detector_every: DetectorEveryOption = 1,
    detector_threshold: DetectorThresholdOption = 0.25,
    replace: ReplaceOption = False,
    partial: PartialOption = False,
    leave_out: Annotated[
        list[str] | None,
        typer.Option(
            help="Files that are not fetched, *.h264; may be repeated. Annotations and stamps need no video.",
            metavar="PATTERN",
        ),
    ] = None,
    parquet: Annotated[
        str | None,
        typer.Option(help="Write sightings and poses as Parquet here too.", metavar="FOLDER|URL"),
    ] = None,
    queue: Annotated[
        bool, typer.Option("--queue", help="Only put the drives into the queue, for `twin fleet work`.")
    ] = False,
    match: Annotated[bool, typer.Option(help="Match when the last drive is in.")] = True,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Ingest many drives: each whole, once, or not at all, whatever is killed meanwhile.

    A drive of which no file has changed since it was done is left alone.
    """
    from twin.errors import ConfigError
    from twin.fleet import Queue, drives_at
    from twin.store.store import Store

    asked: dict[str, Any] = {
        "method": method.value,
        "errors": stated_errors(error or []),
        "terrain": _here(terrain),
        "terrain_heights": terrain_heights,
        "labels": _here(labels),
        "detector": detector
        and {"model": _here(detector), "every": detector_every, "threshold": detector_threshold},
        "replace": replace,
        "partial": partial,
        "leave_out": leave_out,
        "parquet": parquet if parquet is None or "://" in parquet else _here(Path(parquet)),
        "no_match": not match,
    }
    options = {name: value for name, value in asked.items() if value}
    if queue + (workers is not None) + (scheduler is not None) > 1:
        raise ConfigError("--workers, --scheduler and --queue each say who does the work: give one of them.")
    engines = nullcontext() if queue else _engine(workers, scheduler)
    with engines as engine:
        with made_store(store) as opened:
            addresses = [address for one in drives for address in drives_at(one)]
            added = Queue(opened).add(JobKind.INGEST, addresses, options)
            is_synced = opened.fact("mirror") is not None
            if match and is_synced:
                Queue(opened).add(JobKind.MATCH, [""], {})
        if match and not is_synced:
            note("The store has no NVDB signs yet: nothing is matched until `twin sync-nvdb` has run.")
        note(f"{added.n_new:,} drives are new in the queue, {added.n_again:,} are looked at again.")
        if added.n_there:
            note(f"{added.n_there:,} were in it already: `twin fleet status` shows how far they are.")
        if engine is not None:
            with Store.open(store, create=False) as opened:
                _work(opened, engine, stay=False, json_output=json_output)
        elif json_output:
            print_json(added)


@app.command("work", epilog="Example: twin fleet work --store postgresql://twin@db/twin --workers 4 --stay")
def work(
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    stay: Annotated[
        bool, typer.Option("--stay", help="Wait for more when the queue is empty, until Ctrl-C or SIGTERM.")
    ] = False,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Work on what the queue holds; any number of machines may do so at once."""
    from twin.store.store import Store

    with _engine(workers, scheduler) as engine, Store.open(store, create=False) as opened:
        _work(opened, engine, stay=stay, json_output=json_output)


@app.command("status", epilog="Example: twin fleet status")
def status(store: StoreOption = DEFAULT_STORE, json_output: JsonOption = False) -> None:
    """Show how far the queue is: what runs where, what is parked and why."""
    from twin.fleet import Queue
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        jobs = Queue(opened).jobs()
    counts = Counter(job.state for job in jobs if job.kind is JobKind.INGEST)
    shown = {state: [job for job in jobs if job.state is state] for state in JobState}
    running, parked = shown[JobState.RUNNING], shown[JobState.PARKED]
    if json_output:
        drives = {state.value: counts[state] for state in JobState}
        print_json(
            {"drives": drives, "running": list(map(asdict, running)), "parked": list(map(asdict, parked))}
        )
        return
    print_table("Drives", ["state", "drives"], [(state.value, counts[state]) for state in JobState])
    if running:
        rows = [(_name(job), job.worker, job.claim) for job in running[:_MOST_SHOWN]]
        print_table("Running", ["drive", "by", "run"], rows, right_from=2)
    if parked:
        parts = [(_name(job), job.fault, job.n_failed or job.n_lost, job.reason) for job in parked]
        print_table("Parked", ["drive", "kind", "times", "why"], parts[:_MOST_SHOWN], right_from=9)
        note("`twin fleet retry` lets them run again once the cause is mended; --kind chooses.")


@app.command("retry", epilog="Example: twin fleet retry --kind storage")
def retry(
    drives: Annotated[
        list[str] | None, typer.Argument(help="Only these, as the status names them.", metavar="DRIVE...")
    ] = None,
    kind: Annotated[
        list[Fault] | None, typer.Option(help="Only those parked for this; may be repeated.")
    ] = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Let parked drives wait again, for the next worker."""
    from twin.fleet import Queue
    from twin.store.store import Store

    with Store.open(store, create=False) as opened:
        n = Queue(opened).retry(kind or (), drives or ())
    if json_output:
        print_json({"waiting_again": n})
        return
    print_line(f"{n:,} of the parked wait again.")


def _name(job: Job) -> str:
    return job.address or job.kind.value


def _here(path: Path | None) -> str | None:
    """Return a path as every process of this machine finds it."""
    return None if path is None else str(path.absolute())


@contextmanager
def _engine(workers: int | None, scheduler: str | None) -> Iterator[Executor]:
    """Give what drives are located by."""
    from twin.fleet import DaskCluster, LocalProcesses

    engine: Executor
    engine = DaskCluster(scheduler) if scheduler else LocalProcesses(workers or os.cpu_count() or 1)
    try:
        yield engine
    finally:
        engine.close()


def _work(store: Store, engine: Executor, *, stay: bool, json_output: bool) -> None:
    """Work, and tell what came of it; exit code 4 where a drive was parked."""
    from twin.fleet import work as work_off

    with steps(quiet=json_output) as progress:
        tally = work_off(store, engine, stay=stay, progress=progress)
    for address in tally.parked:
        warn(f"{address or 'the match'} is parked: `twin fleet status` says why.")
    if json_output:
        print_json(tally)
    else:
        print_line(_told(tally))
    if tally.parked:
        raise typer.Exit(EXIT_DATA)


def _told(tally: Tally) -> str:
    matched = ", and matched" if tally.is_matched else ""
    return (
        f"{tally.n_ingested:,} drives ingested, {tally.n_unchanged:,} unchanged, "
        f"{len(tally.parked):,} parked{matched}."
    )
