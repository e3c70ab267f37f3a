"""Labels of annotations, from the drive folder to the findings."""

from __future__ import annotations

import re
from pathlib import Path

import sqlalchemy as sa
from annotation_edits import as_boxes, edit_tracks
from command_line import Twin

from twin.export.from_store import layers_from_store
from twin.ingest import IngestReport, ingest_drive
from twin.matching.match_store import match
from twin.store import schema
from twin.store.store import Store

RAIL_END = 14
"""Rekkverksende."""
LABELS = f'[labels]\n"guard rail end" = {{ type = {RAIL_END} }}\n'


def new_object(store: Store) -> str:
    """Name of the only object that NVDB does not have."""
    ((place),) = store.rows(
        sa.select(schema.change.c.east_m, schema.change.c.north_m).where(schema.change.c.verdict == "new")
    )
    here = (schema.estimate.c.east_m == place["east_m"]) & (schema.estimate.c.north_m == place["north_m"])
    return str(store.rows(sa.select(schema.estimate.c.object).where(here))[0]["object"])


def relabel(trip: Path, name: str, label: str) -> None:
    """Give the tracks of one object another label, and no sign code."""

    def changed(track: str) -> str:
        if f'"object">{name}<' not in track:
            return track
        track = track.replace('label="skilt"', f'label="{label}"', 1)
        return re.sub(r'("skiltnummer">)[^<]*', r"\1", track)

    edit_tracks(trip, changed)


def n_unplaced(store: Store, method: str) -> int:
    """How many signs without a position the drive has by a method."""
    table = schema.drive_method.c
    ((row),) = store.rows(sa.select(table.n_unplaced).where(table.method == method))
    return int(row["n_unplaced"])


def says(report: IngestReport, words: str) -> bool:
    """Whether one of the warnings has the words."""
    return any(words in warning for warning in report.warnings)


def test_object_of_another_type_is_located_and_not_compared(opened: Store, trip: Path) -> None:
    """With labels.toml a guard rail's end is no new sign: it is exported with its own NVDB type."""
    name = new_object(opened)
    relabel(trip, name, "guard rail end")
    (trip / "labels.toml").write_text(LABELS)
    report = ingest_drive(opened, trip)
    assert says(report, "1 of 15 annotated objects are no signs (NVDB types 14)")
    assert not says(report, "No sign code")
    assert report.n_estimates == 15
    found = match(opened)
    assert (found.verdicts["new"], found.n_poles) == (0, 14)
    exported = layers_from_store(opened, "adjusted").estimates.set_index("object")["nvdb_type"]
    assert exported.to_dict() == {other: RAIL_END if other == name else 95 for other in exported.index}


def test_object_of_another_type_without_a_place_hides_no_sign(opened: Store, trip: Path) -> None:
    """A face that one frame cannot place may be any sign, but not if its label says that it is none."""
    relabel(trip, new_object(opened), "guard rail end")
    as_boxes(trip, holding='label="guard rail end"')
    ingest_drive(opened, trip, method="single-frame")
    assert n_unplaced(opened, "single-frame") == 1
    (trip / "labels.toml").write_text(LABELS)
    ingest_drive(opened, trip, method="single-frame")
    assert n_unplaced(opened, "single-frame") == 0


def test_label_that_nothing_maps_is_listed_and_stays_a_sign(opened: Store, trip: Path) -> None:
    """Without labels.toml the object is a sign of unknown type, and the warning says which label that is."""
    relabel(trip, new_object(opened), "guard rail end")
    report = ingest_drive(opened, trip)
    assert says(report, "No sign code for the labels guard rail end (")
    assert match(opened).n_poles == 15


def test_label_that_is_ignored_is_left_out_and_counted(opened: Store, trip: Path) -> None:
    """Nothing of it reaches the store but the count."""
    name = new_object(opened)
    relabel(trip, name, "a parked car")
    (trip / "labels.toml").write_text('[labels]\n"a parked *" = "ignore"\n')
    report = ingest_drive(opened, trip)
    assert report.n_estimates == 14
    (count,) = (
        n for reason, n in report.skipped.items() if reason == "labels: no road object: 'a parked car'"
    )
    assert count > 10


def test_labels_option_stands_in_for_the_drives_own(
    twin: Twin, store: Path, trip: Path, tmp_path: Path
) -> None:
    """``--labels FILE`` is read instead of labels.toml, wherever it lies."""
    with Store.open(store) as opened:
        name = new_object(opened)
    relabel(trip, name, "guard rail end")
    (trip / "labels.toml").write_text('[labels]\n"guard rail end" = "ignore"\n')
    (tmp_path / "ours.toml").write_text(LABELS)
    answer = twin("ingest-drive", trip, "--labels", tmp_path / "ours.toml", "--store", store)
    assert answer.code == 0
    assert "NVDB types 14" in answer.err
    answer = twin("ingest-drive", trip, "--labels", tmp_path / "none.toml", "--store", store)
    assert answer.code == 4
    assert "none.toml cannot be read" in answer.err
