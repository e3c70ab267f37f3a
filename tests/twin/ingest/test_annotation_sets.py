"""The same recording with other annotations: nothing that a store holds goes without being asked for."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import pytest
import sqlalchemy as sa
from annotation_edits import edit_tracks, without_tracks
from command_line import Twin
from store_rows import located

from twin.errors import ConfigError, RefusedError
from twin.ingest.ingest import ingest_drive
from twin.ingest.save import save_drive
from twin.store import schema
from twin.store.annotation_sets import AnnotationSet, all_annotation_sets, use_annotation_set
from twin.store.store import Row, Store

ALL_TABLES = (schema.drive, schema.drive_method, schema.sighting, schema.estimate)


def counts(store: Store) -> list[int]:
    """Rows of every table that a drive has."""
    return [store.count(table) for table in ALL_TABLES]


def content(store: Store) -> list[list[Row]]:
    """All that others read of the drives."""
    return [store.rows(sa.select(t).order_by(*t.primary_key.columns)) for t in ALL_TABLES]


def sets_of(store: Store) -> list[AnnotationSet]:
    """The sets of the one drive."""
    return [named.annotation_set for named in all_annotation_sets(store)]


@pytest.fixture
def other_trip(trip: Path) -> Path:
    """Another person's annotations of the sample's recording: three poles less."""
    other = Path(shutil.copytree(trip, trip.with_name("other")))
    for pole in ("P01", "P02", "P03"):
        without_tracks(other, f">{pole}<")
    return other


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


def test_other_annotations_count_and_those_before_are_kept(
    twin: Twin, opened: Store, other_trip: Path
) -> None:
    """One sentence says what counts now and how to go back; the way back restores every row."""
    before = content(opened)
    answer = twin("ingest-drive", other_trip, "--method", "paper", "--store", opened.path)
    assert answer.code == 0
    (first, second) = sets_of(opened)
    assert (first.number, first.is_current, second.number, second.is_current) == (1, False, 2, True)
    assert 0 < second.n_objects < first.n_objects
    assert second.folder == str(other_trip)
    told = " ".join(answer.err.split())
    assert f"{second.n_objects} objects count now (set 2), not the {first.n_objects}" in told
    assert f"twin drives use {first.drive_id} 1" in told
    assert opened.count(schema.estimate) == second.n_objects
    assert opened.methods() == ["paper"]
    assert twin("export", other_trip.with_name("out"), "--store", opened.path).code == 5

    for name in ("other", "trip_trondheim"):  # whichever folder's name it is
        assert twin("drives", "use", name, "1", "--store", opened.path).code == 0
        assert content(opened) == before
    assert [one.is_current for one in sets_of(opened)] == [True, False]


def test_choice_of_an_annotation_set_makes_findings_stale(opened: Store, other_trip: Path) -> None:
    """Both ways; the one that counts already changes nothing."""
    revisions = [opened.revision()]
    drive_id = ingest_drive(opened, other_trip, method="paper").drive_id
    for number in (1, 2, 2):
        revisions.append(opened.revision())
        use_annotation_set(opened, drive_id, number)
    assert revisions[0] < revisions[1] < revisions[2] < revisions[3] == opened.revision()


def test_same_annotations_read_again_stay_one_set(opened: Store, trip: Path) -> None:
    """Another calibration and other meanings of labels replace the set's own results."""
    settings = trip / "drive.toml"
    settings.write_text(settings.read_text() + "pole_radius_m = 0.06\n")
    (trip / "labels.toml").write_text('[labels]\nskilt = "362.50"\n')
    report = ingest_drive(opened, trip, method="paper")
    (one,) = sets_of(opened)
    assert (report.annotation_set, one.number, one.is_current) == (1, 1, True)
    assert opened.methods() == ["paper"]
    assert not any("set" in warning.split() for warning in report.warnings)


def test_set_that_comes_again_keeps_its_number_and_its_other_methods(
    opened: Store, trip: Path, other_trip: Path
) -> None:
    """The first folder read again after the second one is set 1 again, with all its methods."""
    ingest_drive(opened, other_trip, method="paper")
    report = ingest_drive(opened, trip, method="paper")
    assert report.annotation_set == 1
    assert [one.is_current for one in sets_of(opened)] == [True, False]
    assert opened.methods() == ["adjusted", "paper", "single-frame"]


def test_annotations_of_an_incomplete_drive_do_not_replace_complete_ones(
    twin: Twin, opened: Store, other_trip: Path
) -> None:
    """They are kept, findings stay good, and whoever wants lets them count."""
    settings = other_trip / "drive.toml"
    settings.write_text(settings.read_text().replace("annotations_complete = true", ""))
    before, revision = content(opened), opened.revision()
    for _ in range(2):
        report = ingest_drive(opened, other_trip, method="paper")
        assert "do not count" in report.warnings[-1]
        assert (content(opened), opened.revision()) == (before, revision)
    assert [(one.number, one.is_current) for one in sets_of(opened)] == [(1, True), (2, False)]
    answer = twin("drives", "use", report.drive_id, 2, "--store", opened.path, "--json")
    assert [one["is_current"] for one in answer.json] == [False, True]
    assert opened.count(schema.estimate) == report.n_estimates


@pytest.mark.parametrize("is_cut_off", [False, True])
def test_one_cameras_empty_file_does_not_replace_its_annotations(
    twin: Twin, opened: Store, trip: Path, *, is_cut_off: bool
) -> None:
    """An export without tracks, and a file of no bytes: the fuller set counts on unless asked."""
    file = "C2_tricam60.xml"
    edit_tracks(trip, lambda _track: "", file)
    if is_cut_off:
        (trip / file).write_bytes(b"")
    before, revision = content(opened), opened.revision()
    report = ingest_drive(opened, trip, method="paper")
    assert "they have nothing of C2_tricam60, and set 1 does" in report.warnings[-1]
    assert f"twin drives use {report.drive_id} 2" in report.warnings[-1]
    assert (content(opened), opened.revision()) == (before, revision)
    answer = twin("ingest-drive", trip, "--replace", "--method", "paper", "--store", opened.path)
    assert answer.code == 0
    assert [(one.number, one.is_current) for one in sets_of(opened)] == [(2, True)]


def test_replace_deletes_the_other_sets(twin: Twin, opened: Store, other_trip: Path) -> None:
    """On purpose: nothing of them is left in any table."""
    answer = twin("ingest-drive", other_trip, "--replace", "--method", "paper", "--store", opened.path)
    assert answer.code == 0
    assert "Deleted as asked for" in answer.err
    (one,) = sets_of(opened)
    assert (one.number, one.is_current) == (2, True)
    assert [opened.count(kept) for kept in schema.KEPT.values()] == [0, 0, 0, 0]


def test_set_of_a_store_that_did_not_keep_its_hash_is_known_by_the_files(opened: Store, trip: Path) -> None:
    """The same files are the same set; with any other file the store cannot tell, and keeps both."""
    for text, numbers in (("", [1]), ("pole_radius_m = 0.06\n", [1, 2])):
        with opened.transaction() as connection:
            connection.execute(sa.update(schema.annotation_set).values(annotations_sha256=None))
        settings = trip / "drive.toml"
        settings.write_text(settings.read_text() + text)
        ingest_drive(opened, trip, method="paper")
        assert [one.number for one in sets_of(opened)] == numbers


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("use", "nowhere", "1"), "The store has no drive nowhere"),
        (("use", "trip_trondheim", "4"), "no annotation set 4, only 1"),
        (("use", "trip_trondheim"), "stands alone, or with use"),
        (("drop", "trip_trondheim", "1"), "stands alone, or with use"),
    ],
)
def test_set_that_is_not_there_is_named(
    twin: Twin, opened: Store, words: tuple[str, ...], sentence: str
) -> None:
    """A sentence, exit code 2, nothing changed."""
    revision = opened.revision()
    answer = twin("drives", *words, "--store", opened.path)
    assert answer.code == 2
    assert sentence in " ".join(answer.err.split())
    assert opened.revision() == revision


def test_drives_of_one_name_are_told_apart_by_their_ids(opened: Store) -> None:
    """A name that two drives have is refused with both ids."""
    (drive,) = opened.rows(sa.select(schema.drive))
    with opened.transaction() as connection:
        connection.execute(sa.insert(schema.drive), [{**drive, "drive_id": "another"}])
    with pytest.raises(ConfigError, match=f"Several drives .*{drive['drive_id']}, another"):
        use_annotation_set(opened, str(drive["name"]), 1)


PEOPLE = {"a": (3, True), "b": (2, True), "c": (4, False), "nobody": (0, True)}
"""Whose annotations → how many, and whether of a complete drive."""


def read_by(store: Store, person: str, method: str, *, replace: bool) -> None:
    """Save what one person's annotations give: sightings that say whose they are."""
    n, is_complete = PEOPLE[person]
    drive = {"n_annotations": n, "annotations_complete": is_complete, "content_sha256": person}
    found = located(method, objects=[person] * n, annotations_sha256=person, **drive)
    save_drive(store, found, replace=replace)


@pytest.mark.parametrize("seed", range(10))
def test_any_history_keeps_every_set_that_nobody_replaced(empty: Store, seed: int) -> None:
    """Random ingests and choices against a model: who counts, whose methods are there, what is kept."""
    draw = random.Random(seed)
    methods: dict[str, set[str]] = {}
    numbers: dict[str, int] = {}
    current = ""
    for _ in range(40):
        if methods and draw.random() < 0.3:
            current = draw.choice(sorted(methods))
            use_annotation_set(empty, "d", numbers[current])
        else:
            person, method = draw.choice(sorted(PEOPLE)), draw.choice(["adjusted", "paper"])
            replace = draw.random() < 0.1
            if not (PEOPLE[person][0] or replace or not current or not PEOPLE[current][0]):
                with pytest.raises(RefusedError):
                    read_by(empty, person, method, replace=False)
                continue
            read_by(empty, person, method, replace=replace)
            if replace:
                methods = {person: methods.get(person, set())}
            elif current == "nobody" != person:
                del methods[current]
                current = ""
            methods.setdefault(person, set()).add(method)
            if replace or not current or PEOPLE[person][1] or not PEOPLE[current][1]:
                current = person
        sets = sets_of(empty)
        numbers = {str(one.annotations_sha256): one.number for one in sets}
        assert set(numbers) == set(methods)
        assert [one.annotations_sha256 for one in sets if one.is_current] == [current]
        seen = empty.rows(sa.select(schema.sighting.c.object, schema.sighting.c.method))
        assert len(seen) == PEOPLE[current][0] * len(methods[current])
        assert {one["object"] for one in seen} <= {current}
        n_kept = sum(PEOPLE[p][0] * len(methods[p]) for p in methods if p != current)
        assert empty.count(schema.KEPT[schema.sighting]) == n_kept
