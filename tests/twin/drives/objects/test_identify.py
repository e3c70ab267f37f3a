"""Drives whose annotator gave no ids, and ids that contradict the geometry."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from annotation_edits import edit_tracks

from geoloc.trajectory.trajectory import Trajectory
from twin.drives.annotations.gather import only
from twin.drives.drive import Drive
from twin.drives.objects.identify import FOUND, id_warnings, with_objects
from twin.drives.read import read_drive
from twin.ingest.locate import trajectory_of
from twin.samples.demo import sample_folder


def as_image_task(tracks: Path, *, keep: frozenset[str] = frozenset()) -> None:
    """Rewrite a file of tracks as an image task whose points carry no id, but for the objects in `keep`."""
    root = ET.parse(tracks).getroot()
    pictures: dict[int, list[ET.Element]] = {}
    for track in root.iter("track"):
        for points in track.iter("points"):
            if points.get("outside") == "0":
                points.set("label", str(track.get("label")))
                pictures.setdefault(int(str(points.get("frame"))), []).append(points)
    size = {name: str(root.findtext(f"meta/task/original_size/{name}")) for name in ("width", "height")}
    for track in root.findall("track"):
        root.remove(track)
    for frame, shapes in sorted(pictures.items()):
        image = ET.SubElement(root, "image", id=str(frame), name=f"{tracks.stem}_{frame:06d}.png", **size)
        for points in shapes:
            for attribute in points.findall("attribute"):
                if attribute.get("name") == "object" and attribute.text not in keep:
                    points.remove(attribute)
            image.append(points)
    ET.ElementTree(root).write(tracks, encoding="utf-8")


@cache
def sample_drive() -> tuple[Drive, Trajectory]:
    """The sample's drive as it is."""
    drive = read_drive(sample_folder() / "trip_trondheim")
    return drive, trajectory_of(drive)


def without_ids(folder: Path, *, keep: frozenset[str] = frozenset()) -> Drive:
    """Read the sample's drive, annotated as image tasks without ids."""
    trip = Path(shutil.copytree(sample_folder() / "trip_trondheim", folder / "trip"))
    for file in trip.glob("*.xml"):
        as_image_task(file, keep=keep)
    return read_drive(trip)


def objects_by_place(drive: Drive) -> dict[tuple[str, int, float, float], str]:
    """(camera, frame, pixel) → object."""
    notes = drive.annotations
    keys = zip(notes.camera.tolist(), notes.frame.tolist(), *notes.pixel_px.T.tolist(), strict=True)
    return dict(zip(keys, notes.object.tolist(), strict=True))


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    """The sample's drive, of which no annotation has an id."""
    return without_ids(tmp_path_factory.mktemp("bare"))


def test_tracks_of_two_cameras_become_the_poles_they_show(tmp_path: Path) -> None:
    """Without the attribute object every track is its own camera's: by place they are the 15 poles."""
    trip = Path(shutil.copytree(sample_folder() / "trip_trondheim", tmp_path / "trip"))
    edit_tracks(trip, lambda track: re.sub(r'\s*<attribute name="object">[^<]*</attribute>', "", track))
    apart = read_drive(trip)
    drive = with_objects(apart, trajectory_of(apart))
    assert (apart.annotations.is_track & apart.annotations.has_id).all()
    assert np.unique(apart.annotations.object).size == 30
    truth = objects_by_place(sample_drive()[0])
    pairs = {(name, truth[place]) for place, name in objects_by_place(drive).items()}
    assert len(pairs) == len({name for name, _ in pairs}) == 15
    assert "30 tracks have no attribute object: by position they are 15" in drive.warnings[-1].sentence


def test_annotations_without_ids_become_the_poles_they_show(bare: Drive) -> None:
    """Image tasks without ids give the sample's 15 poles, and hardly any annotation lands at a wrong one.

    Slips of the hand, which stand nowhere, are in the drive's account of what was left out.
    """
    assert not bare.annotations.has_id.any()
    drive = with_objects(bare, trajectory_of(bare))
    truth = objects_by_place(sample_drive()[0])
    pairs = [(truth[key], name) for key, name in objects_by_place(drive).items()]
    found = {name for _, name in pairs}
    assert len(found) == 15
    assert all(name.startswith(FOUND) for name in found)
    owner = {name: max({t for t, _ in pairs}, key=lambda t: pairs.count((t, name))) for name in found}
    assert len(set(owner.values())) == 15
    assert np.mean([owner[name] == true for true, name in pairs]) >= 0.99
    assert "by position they are 15 objects" in drive.warnings[-1].sentence
    (slips,) = (skipped for skipped in drive.skipped if "slip of the hand" in skipped.reason)
    assert slips.count == bare.annotations.frame.size - drive.annotations.frame.size
    assert 1 <= slips.count <= 10


def with_ordinary_fixes(drive: Drive) -> Drive:
    """The drive with one antenna whose fixes are good to 2 m."""
    one = drive.gnss[0]
    return replace(drive, gnss=(replace(one, quality=np.ones_like(one.quality)),))


def test_track_of_ordinary_fixes_gives_each_pole_once(bare: Drive) -> None:
    """Still the sample's 15 poles, none of them twice."""
    poor = with_ordinary_fixes(bare)
    drive = with_objects(poor, trajectory_of(poor))
    assert "by position they are 15 objects" in drive.warnings[-1].sentence
    assert np.unique(drive.annotations.object).size == 15


def test_annotations_without_ids_join_ids_that_were_given(tmp_path: Path) -> None:
    """Where only one pole was named, its name stays, and the others get their own."""
    bare = without_ids(tmp_path, keep=frozenset({"P03"}))
    drive = with_objects(bare, trajectory_of(bare))
    names = set(drive.annotations.object.tolist())
    assert len(names) == 15
    assert "P03" in names
    truth = objects_by_place(sample_drive()[0])
    assert all(name == "P03" for key, name in objects_by_place(drive).items() if truth[key] == "P03")


def test_drive_with_ids_is_left_alone() -> None:
    """Ids that the annotator gave are not second-guessed."""
    drive, trajectory = sample_drive()
    assert drive.annotations.has_id.all()
    assert with_objects(drive, trajectory) is drive


def test_right_ids_give_no_warning() -> None:
    """The sample's ids are not doubted."""
    assert id_warnings(*sample_drive()) == ()


def test_right_ids_on_a_track_of_ordinary_fixes_give_no_warning() -> None:
    """Rays that miss one another because the track is off are no doubt about ids."""
    poor = with_ordinary_fixes(sample_drive()[0])
    assert id_warnings(poor, trajectory_of(poor)) == ()


def test_right_ids_of_a_lens_that_nobody_calibrated_give_no_warning() -> None:
    """A focal length 15 % off lets rays miss one another: no id is doubted but one on two signs."""
    drive, trajectory = sample_drive()
    notes = drive.annotations
    middle_px = np.array([959.5, 603.5])
    longer = replace(notes, pixel_px=middle_px + 1.15 * (notes.pixel_px - middle_px))
    nominal = replace(drive, annotations=longer)
    assert id_warnings(nominal, trajectory, 0.15) == ()
    ids = np.where((notes.object == "P09") & (notes.frame % 2 == 0), "P02", notes.object)
    wrong = replace(drive, annotations=replace(longer, object=ids))
    (told,) = [w.sentence for w in id_warnings(wrong, trajectory, 0.15) if "'P02'" in w.sentence]
    assert "marks two signs" in told


@pytest.mark.parametrize(
    ("one", "other", "sentence"),
    [
        (
            "P02",
            "P03",
            r"The id 'P02' marks two signs. One: 32 annotations .skilt 516. in C2_tricam60.xml frames 105 to",
        ),
        (
            "P02",
            "twin of P02",
            r"The ids 'P02' and 'twin of P02' are one sign.* frames \d+ to \d+.* Give both the same id",
        ),
    ],
)
def test_wrong_ids_give_a_warning(one: str, other: str, sentence: str) -> None:
    """A track that jumps to another pole midway, and one that was begun anew, are named in a sentence."""
    drive, trajectory = sample_drive()
    notes = drive.annotations
    late = notes.frame > np.median(notes.frame[notes.object == one])
    swapped = notes.object.astype("U20")
    swapped[late & (notes.object == one)] = other
    swapped[late & (notes.object == other)] = one
    wrong = replace(drive, annotations=replace(notes, object=swapped))
    assert any(re.match(sentence, warning.sentence) for warning in id_warnings(wrong, trajectory))


def test_ids_that_were_drawn_in_one_picture_are_two_signs() -> None:
    """Key frames in different pictures fit one place; what was drawn between them shows both at once."""
    drive, trajectory = sample_drive()
    notes = drive.annotations
    halves = notes.object.astype("U20")
    halves[(notes.object == "P02") & (notes.frame % 2 == 1)] = "beside P02"
    apart = replace(drive, annotations=replace(notes, object=halves))
    assert any("are one sign" in warning.sentence for warning in id_warnings(apart, trajectory))
    drawn = only(notes, (notes.object == "P02") & (notes.frame % 2 == 1))
    assert id_warnings(replace(apart, interpolated=drawn), trajectory) == ()
