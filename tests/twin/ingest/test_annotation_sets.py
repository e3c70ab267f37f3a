"""The same recording with other annotations: nothing that a store holds goes without being asked for."""

from __future__ import annotations

import shutil
from pathlib import Path

from annotation_edits import without_tracks
from command_line import Twin

from twin.store import schema
from twin.store.store import Store

ALL_TABLES = (schema.drive, schema.drive_method, schema.sighting, schema.estimate)


def counts(store: Store) -> list[int]:
    """Rows of every table that a drive has."""
    return [store.count(table) for table in ALL_TABLES]


def test_folder_without_annotations_leaves_the_drives_estimates(
    twin: Twin, opened: Store, trip: Path
) -> None:
    """No file, and files without a track: refused with a sentence, exit code 5, and findings stay good."""
    without_files = Path(shutil.copytree(trip, trip.with_name("bare")))
    for path in without_files.glob("*.xml"):
        path.unlink()
    without_tracks(trip)
    before, revision = counts(opened), opened.revision()
    for folder in (without_files, trip):
        answer = twin("ingest-drive", folder, "--store", opened.path)
        assert answer.code == 5
        assert "--replace" in answer.err
        assert str(folder) in answer.err
        assert (counts(opened), opened.revision()) == (before, revision)


def test_folder_without_annotations_replaces_them_when_asked(twin: Twin, opened: Store, trip: Path) -> None:
    """`--replace` is the word for it; without it an empty drive follows an empty one."""
    without_tracks(trip)
    for options in (("--replace",), ()):
        answer = twin("ingest-drive", trip, *options, "--store", opened.path, "--json")
        assert answer.code == 0
        assert counts(opened) == [1, 1, 0, 0]
