"""Tracks that an annotation tool filled up between key frames: positions come of the key frames alone."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import sqlalchemy as sa
from annotation_edits import as_boxes, edit_tracks

from twin.ingest.ingest import ingest_drive
from twin.matching.poles.seen_in import pictures_of
from twin.store import schema
from twin.store.kinds import Method
from twin.store.store import Row, Store

OFF_PX = 40.0


def filled(track: str) -> str:
    """Draw a row beside each key frame, in the next picture and far from where the pole is seen."""

    def beside(row: re.Match[str]) -> str:
        frame, x, y = int(row[2]), float(row[4]), float(row[5])
        drawn = f'{row[1]}{frame + 1}{row[3]}{x + OFF_PX},{y}"'.replace('keyframe="1"', 'keyframe="0"')
        return f"{row[0]}{row[6]}</points>{drawn}{row[6]}"

    return re.sub(
        r'(<points frame=")(\d+)(" outside="0"[^>]* points=")([\d.]+),([\d.]+)"(?=([^>]*>.*?)</points>)',
        beside,
        track,
        flags=re.DOTALL,
    )


def unset(trip: Path, pole: str, keep: int) -> None:
    """Let the first key frames of a pole's tracks be the only ones."""

    def few(track: str) -> str:
        if f">{pole}<" not in track:
            return track
        before, *rows = track.split('keyframe="1"')
        return before + "".join(f'keyframe="{k < keep:d}"{row}' for k, row in enumerate(rows))

    edit_tracks(trip, few)


def estimates(store: Store) -> list[Row]:
    """Every column of every estimate."""
    return store.rows(sa.select(schema.estimate).order_by(schema.estimate.c.estimate_id))


@pytest.mark.parametrize("method", list(Method))
def test_positions_are_those_of_the_key_frames(method: Method, empty: Store, trip: Path) -> None:
    """To the last bit, though every second row is 40 px off; these show in which pictures a pole was seen."""
    before = ingest_drive(empty, trip, method=method)
    alone = estimates(empty)
    more = Path(shutil.copytree(trip, trip.with_name("more")))
    edit_tracks(more, filled)
    after = ingest_drive(empty, more, method=method)
    assert estimates(empty) == alone
    assert (after.n_annotations, after.n_located) == (before.n_annotations, before.n_located)
    (n,) = (n for what, n in after.skipped.items() if what.startswith("annotations: interpolated"))
    assert n > 0.9 * before.n_annotations
    is_drawn = ~schema.sighting.c.is_measured
    drawn = empty.rows(sa.select(schema.sighting).where(is_drawn, schema.sighting.c.object == "P01"))
    assert {row["rejected"] for row in drawn} == {"interpolated between key frames: seen, but not measured"}
    with empty.snapshot() as view:
        pictures = pictures_of(view, [(f"{after.drive_id}:P01", f"{after.drive_id}:P02")], method)
    assert {(row["camera"], row["frame"], row["kind"]) for row in drawn} <= pictures[f"{after.drive_id}:P01"]


def test_sign_without_a_key_frame_was_seen_all_the_same(empty: Store, trip: Path) -> None:
    """It has no position, which is said, and the complete drive cannot show that a sign is missing."""
    unset(trip, "P02", 0)
    report = ingest_drive(empty, trip)
    assert "P02" not in {row["object"] for row in estimates(empty)}
    assert any("without a key frame: 1 (such as P02)" in warning for warning in report.warnings)
    (kept,) = empty.rows(sa.select(schema.drive_method.c.n_unplaced))
    assert kept["n_unplaced"] == 1
    assert any("cannot show that a sign is missing" in warning for warning in report.warnings)


def test_face_with_one_key_frame_has_no_position_and_the_cure(empty: Store, trip: Path) -> None:
    """One ray meets no other; what was drawn beside it does not count as one."""
    as_boxes(trip, holding=">P02<")
    unset(trip, "P02", 1)
    (wide, *_) = sorted(trip.glob("C3*.xml"))
    for other in set(trip.glob("*.xml")) - {wide}:
        other.write_text(
            re.sub(r"<track (?:(?!</track>).)*>P02<.*?</track>", "", other.read_text(), flags=re.DOTALL)
        )
    report = ingest_drive(empty, trip)
    (told,) = (warning for warning in report.warnings if "want of key frames" in warning)
    assert told.startswith("Annotated objects without a position for want of key frames: 1 (such as P02)")
    assert "three pictures or more" in told
