"""Drives of whose annotations most were left out: no success, unless it was asked for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from annotation_edits import edit_tracks
from command_line import Twin

from twin.drives.plausibility import mostly_left_out
from twin.drives.read import read_drive
from twin.errors import DriveError
from twin.ingest.ingest import ingest_drive
from twin.store import schema
from twin.store.annotation_sets import all_annotation_sets
from twin.store.store import Store


def spoil(trip: Path, share: float) -> None:
    """Put this share of the points outside the picture, the first of each track."""

    def moved(track: str) -> str:
        points = re.split(r'(?= points=")', track)
        last = round(share * (len(points) - 1))
        far = (re.sub(r' points="[^"]*"', ' points="-50,-50"', one) for one in points[1 : 1 + last])
        return "".join([points[0], *far, *points[1 + last :]])

    edit_tracks(trip, moved)


def test_drive_that_lost_most_annotations_is_refused(twin: Twin, opened: Store, trip: Path) -> None:
    """By both commands in the same sentence, with exit code 4, and the store keeps what it has."""
    spoil(trip, 0.7)
    before = [opened.count(table) for table in (schema.estimate, schema.sighting)], opened.revision()
    answer = twin("ingest-drive", trip, "--store", opened.path)
    assert answer.code == 4
    told = re.sub(r"\s+", " ", answer.err)
    said = re.search(
        r"More than half of the annotations of .* cannot be used, [\d,]+ of [\d,]+ \(.*--partial\.", told
    )
    assert said is not None
    assert "C3_tricam120.xml: outside the image" in said[0]
    assert (
        [opened.count(table) for table in (schema.estimate, schema.sighting)],
        opened.revision(),
    ) == before
    seen = twin("inspect", trip, "--json")
    assert seen.code == 4
    assert [re.sub(r"\s+", " ", one) for one in seen.json["refusals"]] == [said[0]]


def test_part_of_a_drive_is_taken_when_asked_and_shows_no_sign_missing(
    twin: Twin, opened: Store, trip: Path
) -> None:
    """It does not take the place of complete annotations, and counts where there are no others."""
    spoil(trip, 0.7)
    answer = twin("ingest-drive", trip, "--store", opened.path, "--partial", "--json")
    assert answer.code == 0
    assert any("does not count as completely annotated" in one for one in answer.json["warnings"])
    sets = [(n.annotation_set.is_complete, n.annotation_set.is_current) for n in all_annotation_sets(opened)]
    assert sets == [(True, True), (False, False)]
    with Store.open(opened.path.with_name("new.db")) as store:
        assert ingest_drive(store, trip, method="paper", partial=True).n_estimates > 0
        (kept,) = store.rows(schema.drive.select())
        assert not kept["annotations_complete"]


def test_half_of_the_annotations_are_enough(trip: Path) -> None:
    """What was left out may be as much as what was not, and no more."""
    spoil(trip, 0.45)
    assert mostly_left_out(read_drive(trip)) == ""
    spoil(trip, 0.6)
    assert mostly_left_out(read_drive(trip))


@pytest.mark.parametrize("is_all", [False, True])
def test_shapes_for_something_else_are_lost_where_there_is_nothing_else(trip: Path, is_all: bool) -> None:
    """Lanes beside signs are none of twin's business; one of nothing but lines was drawn as no sign is."""
    tracks = 0

    def as_lines(track: str) -> str:
        nonlocal tracks
        tracks += 1
        return (
            track
            if tracks == 1 and not is_all
            else track.replace("points ", "polyline ").replace("/points", "/polyline")
        )

    edit_tracks(trip, as_lines)
    if is_all:
        with pytest.raises(DriveError, match="kind polyline"), Store.open(trip.with_name("new.db")) as store:
            ingest_drive(store, trip)
    else:
        assert mostly_left_out(read_drive(trip)) == ""
