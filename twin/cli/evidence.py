"""``twin evidence``: pictures of findings, masked, for whoever decides."""

from __future__ import annotations

import datetime as dt
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.options import DEFAULT_STORE, ByOption, JsonOption, LangOption, StoreOption, person
from twin.cli.output import note, print_json, steps, warn
from twin.errors import ConfigError
from twin.words import Lang, gap_sentence, say

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
        bool, typer.Option("--missing", help="Only for findings that have no masked pictures yet.")
    ] = False,
    masker: Annotated[
        Path | None,
        typer.Option(
            envvar="TWIN_MASKER",
            help="A network that finds people and vehicles (`twin help detector`). Without one, all but "
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
    lang: LangOption = Lang.EN,
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
            _forget(opened, before, person(by, opened), reason or "", lang, json_output=json_output)
            return
        report = _make(opened, masker, missing, reason if unmasked else None, by, quiet=json_output)
    if json_output:
        print_json(report.as_json())
    else:
        _print(report, lang)


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


def _print(report: EvidenceReport, lang: Lang) -> None:
    told = Counter(gap_sentence(gap.why, lang) for gap in report.gaps)
    for sentence, count in told.most_common(_MOST_GAPS):
        warn(sentence if count == 1 else say(lang, "evidence.of_several", sentence=sentence, count=count))
    if len(told) > _MOST_GAPS:
        warn(say(lang, "evidence.more", n=len(told) - _MOST_GAPS))
    if not report.n_findings:
        note(say(lang, "evidence.nothing"))
        return
    how = {"geometry": "evidence.by_geometry", "none": "evidence.not_masked"}
    note(
        say(
            lang,
            "evidence.made",
            pictures=report.n_with_crops,
            findings=report.n_findings,
            crops=report.n_crops,
            how=say(lang, how.get(report.masker, "evidence.by_network"), masker=report.masker),
            new=report.n_new_files,
            deleted=report.n_deleted_files,
        )
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


def _forget(store: Store, before: dt.date, by: str, reason: str, lang: Lang, *, json_output: bool) -> None:
    from twin.evidence import forget

    done: Forgotten = forget(store, before, by=by, reason=reason)
    if json_output:
        print_json(done)
        return
    note(
        say(
            lang,
            "evidence.forgot_of" if done.drives else "evidence.forgot",
            crops=done.n_crops,
            drives=", ".join(done.drives),
            before=done.before,
            findings=len(done.change_ids),
            files=done.n_files,
        )
    )
