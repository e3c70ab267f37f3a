"""A reworded message changes no verdict: every sentence says something else, every finding stays the same."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import sqlalchemy as sa
from drive_damage import Damage, frames_later

from geoloc import reasons
from geoloc.doubts import Doubt
from twin.drives.folder.notes import Skipped
from twin.ingest.ingest import ingest_drive
from twin.ingest.misfits import Misfit
from twin.matching import match
from twin.store import schema
from twin.store.store import Store
from twin.words import Lang
from twin.words import table as words_table

WORDS = "other words"


def reword(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let everything that makes a sentence, or a clause of one, make the same other words."""

    def made_with(record: type, *names: str) -> Callable[..., None]:
        make = record.__init__  # type: ignore[misc]

        def init(self: object, *values: object, **named: object) -> None:
            make(self, *values, **named)
            for name in names:
                object.__setattr__(self, name, WORDS)

        return init

    for record, names in ((Doubt, ("sentence",)), (Skipped, ("reason",)), (Misfit, ("sentence",))):
        monkeypatch.setattr(record, "__init__", made_with(record, *names))
    monkeypatch.setattr(reasons, "_SENTENCES", dict.fromkeys(reasons.Reason, WORDS))
    # Every text of the table, those of reasons, misfits and drives that do not fit themselves among them.
    texts = {key: dict.fromkeys(Lang, WORDS) for key in words_table.table()}
    monkeypatch.setattr(words_table, "_table", lambda: texts)


def as_it_is(_folder: Path) -> None:
    """Damage nothing."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damage", "is_doubted"), [(as_it_is, False), (frames_later(0.3), True)], ids=["sample", "late clock"]
)
def test_reworded_messages_change_no_verdict(
    matched_store: Path,
    trip: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    damage: Damage,
    is_doubted: bool,
) -> None:
    """Neither of the sample nor of a drive that does not fit itself, whatever its warnings say."""
    damage(trip)

    def found(name: str) -> tuple[list[tuple[str, str]], list[str]]:
        path = Path(shutil.copy(matched_store, tmp_path / name))
        with Store.open(path) as store:
            ingest_drive(store, trip)
            match(store, method="adjusted")
            columns = schema.change.c
            rows = store.rows(sa.select(columns.change_id, columns.verdict, columns.reason))
        return sorted((row["change_id"], row["verdict"]) for row in rows), [row["reason"] for row in rows]

    verdicts, told = found("plain.db")
    assert (sum(verdict == "review" for _, verdict in verdicts) > 2) is is_doubted
    with monkeypatch.context() as patches:
        reword(patches)
        reworded, retold = found("reworded.db")
    assert reworded == verdicts
    assert sum(WORDS in reason for reason in retold) >= len(told) / 2
