"""``twin evidence``: pictures of findings, masked, for whoever decides."""

from __future__ import annotations

import datetime as dt
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import DEFAULT_STORE, ByOption, JsonOption, StoreOption, person
from twin.cli.output import note, print_json, steps, warn
from twin.errors import ConfigError

if TYPE_CHECKING:
    from twin.evidence import EvidenceReport, Forgotten
    from twin.store.store import Store

app = typer.Typer()
_MOST_GAPS = 12
"""Sentences that are printed; --json has them all."""


@app.command(
    "evidence",
    epilog="Example: twin evidence --masker people.onnx.  Later: twin evidence --missing.  Clear up: "
    "twin evidence --forget --older-than 180",
)
def evidence(
    missing: Annotated[
        bool, typer.Option("--missing", help="Only for findings that have no pictures yet.")
    ] = False,
    masker: Annotated[
        Path | None,
        typer.Option(
            help="A network that finds people and vehicles (docs/detector.md). Without one, all but "
            "the signs is made unrecognisable.",
            metavar="FILE.onnx",
        ),
    ] = None,
    unmasked: Annotated[
        bool,
        typer.Option(
            "--unmasked", help="Mask nothing; needs --reason and --by. Such pictures are never exported."
        ),
    ] = False,
    reason: Annotated[
        str | None, typer.Option(help="Why: of --unmasked and --forget; kept in the store's log.")
    ] = None,
    by: ByOption = None,
    forget: Annotated[
        bool, typer.Option("--forget", help="Delete pictures instead; needs --older-than.")
    ] = False,
    older_than: Annotated[
        str | None, typer.Option(help="Days, or the first day that stays.", metavar="DAYS|YYYY-MM-DD")
    ] = None,
    store: StoreOption = DEFAULT_STORE,
    json_output: JsonOption = False,
) -> None:
    """Cut pictures of each finding's sign from the drives' recordings, masked before anything is written."""
    from twin.store.store import Store

    before = _before(forget=forget, older_than=older_than, others=missing or unmasked or masker is not None)
    if reason is not None and not (unmasked or forget):
        raise ConfigError(
            "--reason says why nothing is masked or why pictures go: give --unmasked or --forget."
        )
    if unmasked and not (reason and by):
        raise ConfigError(
            "Pictures without masks need --reason and --by (or TWIN_USER): both are kept in the store's log."
        )
    with Store.open(store, create=False) as opened:
        if before is not None:
            _forget(opened, before, person(by), reason or "", json_output=json_output)
            return
        report = _make(opened, masker, missing, reason if unmasked else None, by, quiet=json_output)
    if json_output:
        print_json(report)
    else:
        _print(report)


def _make(
    store: Store, masker: Path | None, missing: bool, reason: str | None, by: str | None, *, quiet: bool
) -> EvidenceReport:
    from twin.evidence import make_evidence
    from twin.evidence.masker import NetworkMasker

    network = None if masker is None else NetworkMasker(masker)
    with steps(quiet=quiet) as progress:
        return make_evidence(
            store, masker=network, missing_only=missing, unmasked_reason=reason, by=by, progress=progress
        )


def _print(report: EvidenceReport) -> None:
    told = Counter(gap.sentence for gap in report.gaps)
    for sentence, count in told.most_common(_MOST_GAPS):
        warn(sentence if count == 1 else f"{sentence} ({count:,} findings)")
    if len(told) > _MOST_GAPS:
        warn(f"{len(told) - _MOST_GAPS} more such sentences: --json has them all.")
    how = {"geometry": "masked by geometry alone", "none": "NOT masked, as asked for"}
    note(
        f"{report.n_with_crops:,} of {report.n_findings:,} findings have pictures: {report.n_crops:,} made, "
        f"{how.get(report.masker, f'masked by {report.masker}')}; {report.n_new_files:,} files are new, "
        f"{report.n_deleted_files:,} were deleted."
    )


def _before(*, forget: bool, older_than: str | None, others: bool) -> dt.date | None:
    """The day before which pictures are deleted; None where none are to be."""
    if not forget and older_than is None:
        return None
    if not forget or older_than is None or others:
        raise ConfigError(
            "--forget and --older-than belong together, and go with nothing that makes pictures: "
            "twin evidence --forget --older-than 180."
        )
    try:
        if older_than.isascii() and older_than.isdigit():
            return dt.datetime.now(dt.UTC).date() - dt.timedelta(days=int(older_than))
        return dt.date.fromisoformat(older_than)
    except (ValueError, OverflowError) as error:
        raise ConfigError(
            f"--older-than {older_than[:40]} is neither days nor a date: write 180 or 2026-06-01."
        ) from error


def _forget(store: Store, before: dt.date, by: str, reason: str, *, json_output: bool) -> None:
    from twin.evidence import forget

    done: Forgotten = forget(store, before, by=by, reason=reason)
    if json_output:
        print_json(done)
        return
    of = f" of {', '.join(done.drives)}" if done.drives else ""
    note(
        f"Deleted {done.n_crops:,} pictures{of} that were taken before {done.before}, of "
        f"{len(done.change_ids):,} findings; {done.n_files:,} files are gone."
    )
