"""Annotated images that a tool gave a name of its own, among a camera's pictures."""

from __future__ import annotations

import json
from typing import Any

import pytest
from left_out import counts

from geoloc.rig.rig import rig_from_document
from twin.drives.annotations.formats.cvat import read_cvat
from twin.drives.annotations.formats.table import read_annotation_json
from twin.drives.annotations.gather import AnnotationsRead, gather
from twin.drives.annotations.picture_names import NOT_AMONG_PICTURES, UPLOADED_TWICE, PictureNames
from twin.drives.frames.find import in_order

WIDE = "C3_wide"
PICTURES = {"IMG_4000.jpg": 3, "IMG_4000": 3, "tur (1) Åre.jpg": 4, "tur (1) Åre": 4}


def label_studio(maker: Any, *images: str) -> AnnotationsRead:
    """Read one keypoint in each image."""
    value = {"x": 10, "y": 50, "keypointlabels": ["202"]}
    size = {"original_width": 1280, "original_height": 800}
    result = [{"id": "a", "type": "keypointlabels", "value": value} | size]
    tasks = [{"data": {"image": image}, "annotations": [{"result": result}]} for image in images]
    file = read_annotation_json(json.dumps(tasks).encode(), "a.json")
    assert file is not None
    return gather([(file, WIDE)], rig_from_document(maker.rig(), "car.json"), image_frames={WIDE: PICTURES})


@pytest.mark.parametrize(
    ("image", "frame"),
    [
        ("ab12cd34-IMG_4000.jpg", 3),
        ("/data/upload/1/ab12cd34-IMG_4000.jpg", 3),
        ("labels/train/12345678-IMG_4000.txt", 3),
        ("images\\ab12cd34-IMG_4000.png", 3),
        ("ab12cd34-tur_1_Åre.jpg", 4),
        ("IMG_4000.jpg", 3),
        ("ab12cd34-IMG_4001.jpg", NOT_AMONG_PICTURES),
        ("ab12cd3-IMG_4000.jpg", NOT_AMONG_PICTURES),
        ("ab12cd34-", NOT_AMONG_PICTURES),
    ],
)
def test_upload_is_the_picture_that_it_was_made_of(image: str, frame: int) -> None:
    """Eight hex digits and a dash before its name, as Label Studio and what it exports have it."""
    assert PictureNames(PICTURES, [image]).frame_of(image) == frame


def test_picture_that_has_the_name_as_it_is_comes_first() -> None:
    """Pictures that came back from Label Studio keep what it put before their names."""
    names = PictureNames(PICTURES | {"ab12cd34-IMG_4000.jpg": 7}, ["ab12cd34-IMG_4000.jpg"])
    assert names.frame_of("ab12cd34-IMG_4000.jpg") == 7


def test_upload_that_may_be_either_of_two_pictures_is_none() -> None:
    """The blank of one is the dash of the other."""
    names = PictureNames({"tur 1.jpg": 0, "tur_1.jpg": 1}, ["ab12cd34-tur_1.jpg"])
    assert names.frame_of("ab12cd34-tur_1.jpg") == NOT_AMONG_PICTURES
    assert names.frame_of("tur_1.jpg") == 1


def test_name_that_was_uploaded_twice_is_left_out() -> None:
    """One may be of another drive, which numbers its pictures alike; the name as it is stays good."""
    images = ["ab12cd34-IMG_4000.jpg", "/data/upload/1/00ff00ff-IMG_4000.jpg", "IMG_4000.jpg"]
    names = PictureNames(PICTURES, images)
    assert [names.frame_of(image) for image in images] == [UPLOADED_TWICE, UPLOADED_TWICE, 3]


def test_uploads_of_a_drives_pictures_are_annotations_of_it(maker: Any) -> None:
    """Also where the address spells a blank or an Å as a percentage; two of one name are counted."""
    read = label_studio(
        maker, "/data/upload/1/ab12cd34-IMG_4000.jpg", "/data/local-files/?d=a/tur%20(1)%20%C3%85re.jpg"
    )
    assert read.annotations.frame.tolist() == [3, 4]
    assert read.skipped == ()
    twice = label_studio(
        maker, "/data/upload/1/ab12cd34-IMG_4000.jpg", "/data/upload/2/12cd34ab-IMG_4000.jpg"
    )
    (reason,) = counts(twice.skipped)
    assert counts(twice.skipped)[reason] == 2
    assert "uploaded twice" in reason
    assert "uploaded twice" in twice.warnings[0]


def test_number_of_a_frame_is_not_what_label_studio_drew(maker: Any) -> None:
    """Without pictures the last digits of the name count, and eight digits before a dash are a number."""
    names = ["ab12cd34-front.png", "ab12cd34-front_12.png", "00000014-front.png"]
    images = "".join(
        f'<image id="{k + 70}" name="{n}"><points label="202" points="5,9"/></image>'
        for k, n in enumerate(names)
    )
    rig = rig_from_document(maker.rig(), "car.json")
    read = gather([(read_cvat(maker.cvat(images).encode(), "a.xml"), WIDE)], rig)
    assert read.annotations.frame.tolist() == [12, 14, 70]


def test_pictures_from_label_studio_are_in_the_order_of_their_own_names() -> None:
    """What it drew says nothing; days before a dash do."""
    assert in_order(["f/0a1b2c3d-10.jpg", "f/ff1b2c3d-9.jpg"]) == ("f/ff1b2c3d-9.jpg", "f/0a1b2c3d-10.jpg")
    assert in_order(["20260611-1.jpg", "20260610-2.jpg"]) == ("20260610-2.jpg", "20260611-1.jpg")
