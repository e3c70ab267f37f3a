"""A finding is a place and a kind: annotators may number their objects as they like, and anew.

``TWIN_HISTORIES=1000`` makes a longer run of it (``make soak``).
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from annotation_edits import edit_tracks
from renumbering_history import FAR_SITES, run_history, story, unknown_poles

from twin.decisions import decide
from twin.decisions.findings import latest_findings
from twin.ingest.ingest import ingest_drive
from twin.matching import match
from twin.store import schema
from twin.store.store import Store

HISTORIES = int(os.environ.get("TWIN_HISTORIES", "8"))
PARTS = 4
NAMES = [f"P{number:02d}" for number in range(1, 16)]
NUMBERED_ANEW = {
    "shifted by one": dict(zip(NAMES, [*NAMES[1:], "P16"], strict=True)),
    "reversed": dict(zip(NAMES, reversed(NAMES), strict=True)),
    "one taken out": {"P05": ""} | dict(zip(NAMES[5:], NAMES[4:], strict=False)),
    "all renamed": {name: f"skilt {number}" for number, name in enumerate(NAMES)},
}


def number_anew(trip: Path, new: Mapping[str, str]) -> None:
    """Give each object another id; without its track where that is empty."""

    def changed(track: str) -> str:
        (name,) = set(re.findall(r'<attribute name="object">(\w+)<', track))
        anew = new.get(name, name)
        return track.replace(f">{name}<", f">{anew}<") if anew else ""

    edit_tracks(trip, changed)


@pytest.mark.parametrize("how", NUMBERED_ANEW)
def test_dismissed_findings_stay_dismissed_when_objects_are_numbered_anew(
    synced: Path, trip: Path, how: str
) -> None:
    """Ingested and matched again: the nine that were dismissed are, by their places, and no other one is."""

    def dismissed(store: Store) -> list[tuple[float, float]]:
        found = [one.finding for one in latest_findings(store.rows) if one.decision == "dismiss"]
        return sorted((one.east_m, one.north_m) for one in found)

    with Store.open(synced) as store:
        with store.transaction() as connection:
            for table in (schema.skiltpunkt, schema.skiltplate):
                connection.execute(sa.delete(table).where(table.c.nvdb_id.not_in(FAR_SITES)))
        ingest_drive(store, trip)
        assert match(store).verdicts["new"] == 15
        # P05, which one annotator takes out, is not among them.
        by_place = sorted((one.finding.east_m, one.change_id) for one in latest_findings(store.rows))
        chosen = [change_id for _, change_id in by_place[6:15]]
        decide(store, chosen, "dismiss", by="kari", reason="private")
        before = dismissed(store)
        assert len(before) == 9
        number_anew(trip, NUMBERED_ANEW[how])
        ingest_drive(store, trip)
        assert match(store).verdicts["new"] == 15 - ("" in NUMBERED_ANEW[how].values())
        # Without one pole the others move by millimetres; the next pole is metres away.
        np.testing.assert_allclose(dismissed(store), before, atol=0.2)


@pytest.fixture(scope="module")
def base(matched_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store with two drives past poles that NVDB does not know."""
    path = tmp_path_factory.mktemp("base") / "twin.db"
    unknown_poles(matched_store, path)
    return path


@pytest.mark.parametrize("part", range(PARTS))
def test_no_history_of_annotating_moves_or_loses_a_decision(base: Path, tmp_path: Path, part: int) -> None:
    """Random histories, each against what the model says must hold."""
    for seed in range(part, HISTORIES, PARTS):
        path = Path(shutil.copy(base, tmp_path / f"{seed}.db"))
        steps, wrong = run_history(path, seed)
        assert not wrong, story(seed, steps, wrong)
        path.unlink()
