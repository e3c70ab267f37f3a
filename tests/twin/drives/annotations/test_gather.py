"""Which camera, frame and object an annotation belongs to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from left_out import counts

from geoloc.rig.rig import rig_from_document
from twin.drives.annotations.formats.cvat import read_cvat
from twin.drives.annotations.gather import AnnotationsRead, gather
from twin.drives.annotations.labels import read_label_map
from twin.errors import DriveError

WIDE, NARROW = "C3_wide", "C1_narrow"


def read(
    maker: Any, files: dict[str, str], *sensors: Any, cameras: dict[str, str] | None = None
) -> AnnotationsRead:
    """Gather CVAT texts by file name, with what drive.toml would declare."""
    rig = rig_from_document(maker.rig(*sensors), "car.json")
    declared = cameras or {}
    return gather([(read_cvat(text.encode(), name), declared.get(name)) for name, text in files.items()], rig)


def image(name: str, *shapes: str, size: tuple[int, int] = (1280, 800), identifier: int = 0) -> str:
    """Build one image of an image task."""
    head = f'<image id="{identifier}" name="{name}" width="{size[0]}" height="{size[1]}">'
    return f"{head}{''.join(shapes)}</image>"


def point(x: float = 5.5, y: float = 6.5, label: str = "202", **attributes: str) -> str:
    """One point with attributes."""
    inner = "".join(f'<attribute name="{k}">{v}</attribute>' for k, v in attributes.items())
    return f'<points label="{label}" points="{x},{y}">{inner}</points>'


@pytest.mark.parametrize(
    ("file", "meta", "name"),
    [
        (f"{WIDE}.xml", "", "1.png"),
        ("trip087-c3_WIDE-final.xml", "", "1.png"),
        ("annotations.xml", f"<source>{WIDE}.h264</source>", "1.png"),
        ("annotations.xml", f"<task><id>1</id><name>Trip087 {WIDE}</name></task>", "1.png"),
        ("annotations.xml", "", f"{WIDE}/frame_1.png"),
        (f"{WIDE}.xml", f"<source>{WIDE}.h264</source>", f"{WIDE}_1.png"),
    ],
)
def test_camera_is_named_by_file_task_or_image(maker: Any, file: str, meta: str, name: str) -> None:
    """Any of them is enough, and they may agree."""
    found = read(maker, {file: maker.cvat(image(name, point()), meta=meta)})
    assert found.annotations.camera.tolist() == [WIDE]
    assert found.annotations.frame.tolist() == [1]
    assert found.cameras == (WIDE,)


def test_camera_that_nothing_names_is_refused_with_the_cure(maker: Any) -> None:
    """The error lists the rig's cameras and what to write into drive.toml."""
    with pytest.raises(
        DriveError, match=r"a\.xml names no camera .*\[annotations\] <camera> = .*C1_narrow, C3_wide"
    ):
        read(maker, {"a.xml": maker.annotations()})


@pytest.mark.parametrize(
    ("file", "meta"), [(f"{WIDE}.xml", f"<source>{NARROW}.h264</source>"), (f"{WIDE} {NARROW}.xml", "")]
)
def test_camera_that_is_named_twice_is_refused(maker: Any, file: str, meta: str) -> None:
    """Names that disagree are not resolved by guessing."""
    with pytest.raises(DriveError, match="could be of C1_narrow or of C3_wide"):
        read(maker, {file: maker.cvat(maker.track(1, {1: (5, 5)}), meta=meta)})


def test_camera_declared_in_the_settings_settles_it(maker: Any) -> None:
    """What drive.toml says comes before every name."""
    found = read(maker, {f"{WIDE}.xml": maker.annotations()}, cameras={f"{WIDE}.xml": NARROW})
    assert set(found.annotations.camera.tolist()) == {NARROW}


def test_camera_names_within_one_another_are_told_apart(maker: Any) -> None:
    """``front`` does not claim the files of ``front:left``, nor C1 those of C10."""
    sensors = [maker.camera(name) for name in ("front", "front:left", "C1", "C10")]
    texts = {
        name: maker.cvat(maker.track(1, {1: (5, 5)})) for name in ("front_left.xml", "front.xml", "C10.xml")
    }
    found = read(maker, texts, *sensors)
    assert found.cameras == ("C10", "front", "front:left")


def test_camera_of_a_rig_with_one_camera_needs_no_name(maker: Any) -> None:
    """There is nothing to confuse it with."""
    found = read(maker, {"a.xml": maker.annotations()}, maker.camera("only"))
    assert found.cameras == ("only",)


def test_camera_of_each_task_of_a_project_is_its_own(maker: Any) -> None:
    """One project export may annotate several cameras."""
    names = ((4, WIDE), (5, NARROW))
    tasks = "".join(f"<task><id>{i}</id><name>{name}</name></task>" for i, name in names)
    tracks = [
        maker.track(i, {i: (5, 5)}).replace("<track ", f'<track task_id="{task}" ')
        for i, task in ((1, 4), (2, 5))
    ]
    found = read(
        maker, {"project.xml": maker.cvat(*tracks, meta=f"<project><tasks>{tasks}</tasks></project>")}
    )
    assert found.annotations.camera.tolist() == [NARROW, WIDE]
    assert found.annotations.object.tolist() == [f"{NARROW}:2", f"{WIDE}:1"]


def test_camera_of_an_unsupported_model_is_refused_only_when_annotated(maker: Any) -> None:
    """The other cameras of the rig stay usable."""
    sensors = (maker.camera("good"), maker.camera("odd", Model="ocam"))
    assert read(maker, {"good.xml": maker.annotations()}, *sensors).cameras == ("good",)
    with pytest.raises(DriveError, match=r"odd\.xml annotates odd.*ocam"):
        read(maker, {"odd.xml": maker.annotations()}, *sensors)


def test_file_without_shapes_still_says_which_camera_was_annotated(maker: Any) -> None:
    """A camera in which no sign was seen was annotated nevertheless."""
    found = read(maker, {f"{WIDE}.xml": maker.cvat(), "b.xml": maker.cvat()})
    assert found.cameras == (WIDE,)
    assert len(found.annotations.frame) == 0
    assert found.annotations.pixel_px.shape == (0, 2)
    assert found.annotations.box_px.shape == (0, 4)


def test_size_that_differs_from_the_rig_is_refused_with_both(maker: Any) -> None:
    """Annotations of a scaled recording would land elsewhere."""
    with pytest.raises(DriveError, match=r"640 x 400 pixels, but C3_wide has 1280 x 800 in car\.json"):
        read(maker, {f"{WIDE}.xml": maker.cvat(image("1.png", point(), size=(640, 400)))})
    meta = "<task><id>1</id><original_size><width>1920</width><height>1208</height></original_size></task>"
    with pytest.raises(DriveError, match="1920 x 1208"):
        read(maker, {f"{WIDE}.xml": maker.cvat(maker.track(1, {1: (5, 5)}), meta=meta)})


def test_shapes_outside_the_image_are_counted(maker: Any) -> None:
    """The edges of the image belong to it, a tenth of a pixel beyond does not."""
    shapes = [point(0, 0), point(1280, 800), point(-0.1, 5), point(5, 800.1)]
    shapes.append('<box label="202" xtl="-700" ytl="5" xbr="700" ybr="50"/>')
    found = read(maker, {f"{WIDE}.xml": maker.cvat(image("1.png", *shapes))})
    assert found.annotations.pixel_px.tolist() == [[-0.5, -0.5], [1279.5, 799.5]]
    reasons = counts(found.skipped)
    assert reasons == {"outside the image": 2, "box larger than the image": 1}


@pytest.mark.parametrize(
    ("name", "identifier", "frame"),
    [
        ("frame_000123.PNG", 0, 123),
        ("trip087/C3_wide/000045.jpg", 0, 45),
        ("000046_C3_wide.jpg", 0, 46),
        ("2026-06-10_17.jpg", 0, 17),
        ("still.jpg", 9, 9),
        ("frame_123_jpg.rf.0a1b2c99.jpg", 0, 123),
    ],
)
def test_frame_of_an_image_is_the_last_number_of_its_name(
    maker: Any, name: str, identifier: int, frame: int
) -> None:
    """Neither the camera's digits nor Roboflow's hash count; without digits the running number does."""
    found = read(maker, {f"{WIDE}.xml": maker.cvat(image(name, point(), identifier=identifier))})
    assert found.annotations.frame.tolist() == [frame]


def test_object_of_one_file_is_the_track_id(maker: Any) -> None:
    """Nothing can be confused with it."""
    found = read(maker, {f"{WIDE}.xml": maker.annotations()})
    assert found.annotations.object.tolist() == ["3", "3", "5"]


def test_object_of_several_cameras_carries_the_camera(maker: Any) -> None:
    """CVAT numbers tracks anew in every file: track 3 of two cameras is two objects."""
    found = read(maker, {f"{WIDE}.xml": maker.annotations(), f"{NARROW}.xml": maker.annotations()})
    assert set(found.annotations.object.tolist()) == {f"{c}:{i}" for c in (WIDE, NARROW) for i in (3, 5)}


def test_object_of_several_files_of_one_camera_carries_the_file(maker: Any) -> None:
    """Two exports of one camera count their tracks from the same number."""
    files = {f"{WIDE}-a.xml": maker.annotations(), f"{WIDE}-b.xml": maker.cvat(maker.track(3, {50: (5, 5)}))}
    found = read(maker, files)
    assert set(found.annotations.object.tolist()) == {
        f"{WIDE}/{WIDE}-a:3",
        f"{WIDE}/{WIDE}-a:5",
        f"{WIDE}/{WIDE}-b:3",
    }


@pytest.mark.parametrize("attribute", ["object", "object_id"])
def test_object_attribute_joins_what_is_physically_one(maker: Any, attribute: str) -> None:
    """The same value is the same pole in every camera; a track without it never takes its name."""
    files = {
        f"{WIDE}.xml": maker.cvat(
            maker.track(3, {1: (5, 5)}, **{attribute: "12"}), maker.track(12, {1: (9, 9)})
        ),
        f"{NARROW}.xml": maker.cvat(maker.track(8, {2: (5, 5)}, **{attribute: "12"})),
    }
    found = read(maker, files).annotations
    assert sorted(zip(found.camera.tolist(), found.object.tolist(), strict=True)) == [
        (NARROW, "12"),
        (WIDE, "12"),
        (WIDE, f"{WIDE}:12"),
    ]


def test_object_attribute_on_one_row_holds_for_the_track(maker: Any) -> None:
    """Exports may write an attribute on the first row only."""
    track = (
        '<track id="1" label="skilt"><points frame="1" outside="0" points="5,5">'
        '<attribute name="object">A</attribute><attribute name="skiltnummer">206</attribute></points>'
        '<points frame="2" outside="0" points="6,6"/></track>'
    )
    found = read(maker, {f"{WIDE}.xml": maker.cvat(track)}).annotations
    assert found.object.tolist() == ["A", "A"]
    assert found.skiltnummer.tolist() == ["206", "206"]


def test_object_of_an_image_task_is_its_track_id_or_one_each(maker: Any) -> None:
    """Points of an image task without any id are objects of their own."""
    images = [image(f"{i}.png", point(5 + i), point(9, track_id="7"), point(20)) for i in (1, 2)]
    found = read(maker, {f"{WIDE}.xml": maker.cvat(*images)}).annotations
    assert sorted(found.object.tolist()) == ["7", "7", "f1.1", "f1.2", "f2.1", "f2.2"]


def test_sign_codes_come_from_the_attribute_then_the_label(maker: Any) -> None:
    """An attribute without a code is counted, and the label speaks instead."""
    shapes = [
        point(1, label="202", skiltnummer="362.50;808.1"),
        point(2, label="206 Forkjørsveg"),
        point(3, label="204", skiltnummer="ukjent"),
        point(4, label="pole"),
    ]
    found = read(maker, {f"{WIDE}.xml": maker.cvat(image("1.png", *shapes))})
    assert found.annotations.skiltnummer.tolist() == ["362.50;808.1", "206", "204", ""]
    assert found.annotations.label.tolist() == ["202", "206 Forkjørsveg", "204", "pole"]
    assert [(s.what, s.count, s.reason) for s in found.skipped] == [
        ("sign codes", 1, "not a sign code: 'ukjent'")
    ]


def test_texts_come_from_the_attribute_on_one_line(maker: Any) -> None:
    """``text`` or ``tekst``, without line breaks and what no file takes; "" where there is none."""
    shapes = [
        point(1, skiltnummer="362.50;808.1", text=";200 m"),
        point(2, tekst=" Gjelder\n  buss\u200b "),
        point(3, text=""),
        point(4, text="a" * 10_000),
    ]
    found = read(maker, {f"{WIDE}.xml": maker.cvat(image("1.png", *shapes))}).annotations
    assert found.text.tolist() == [";200 m", "Gjelder buss", "", "a" * 200]


def test_annotations_do_not_depend_on_the_order_of_files_and_shapes(maker: Any) -> None:
    """Rows are sorted by camera, frame and object."""
    tracks = [maker.track(i, {f: (f + i, 5) for f in (4, 2)}, object=str(i)) for i in (1, 2)]
    texts = {f"{WIDE}.xml": maker.cvat(*tracks), f"{NARROW}.xml": maker.cvat(tracks[0])}
    one = read(maker, texts).annotations
    other = read(
        maker,
        {
            name: maker.cvat(*reversed(tracks)) if name == f"{WIDE}.xml" else text
            for name, text in reversed(texts.items())
        },
    ).annotations
    for column in ("camera", "frame", "object", "pixel_px"):
        assert np.array_equal(getattr(one, column), getattr(other, column))


def test_annotation_given_twice_is_kept_once(maker: Any) -> None:
    """Overlapping exports repeat rows: the same pixel of the same object in the same frame."""
    text = maker.cvat(maker.track(1, {1: (5, 5)}, object="A"))
    found = read(maker, {f"{WIDE}-a.xml": text, f"{WIDE}-b.xml": text})
    assert len(found.annotations.frame) == 1
    assert [(s.count, s.reason) for s in found.skipped] == [(1, "the same annotation again")]


@pytest.mark.parametrize(
    ("label", "codes"),
    [("Fartsgrense femti", "362.50"), ("204", "302"), ("206 old", "206"), ("regulatory--stop--g1", "204")],
)
def test_labels_of_the_drive_come_before_codes_and_defaults(maker: Any, label: str, codes: str) -> None:
    """The drive's own labels, then a code in the label, then the labels that ship."""
    own = read_label_map(b'[labels]\n"fartsgrense femti" = "362.50"\n"204" = "302"\n')
    file = read_cvat(maker.cvat(image("1.png", point(label=label))).encode(), "a.xml")
    found = gather([(file, WIDE)], rig_from_document(maker.rig(), "car.json"), own)
    assert found.annotations.skiltnummer.tolist() == [codes]
    assert found.unmapped == {}


def test_attribute_says_a_sign_whatever_the_label_is(maker: Any) -> None:
    """Skiltnummer comes before a label of another type, and before one that is ignored."""
    own = read_label_map(b'[labels]\nrail = { type = 14 }\ncar = "ignore"\n')
    shapes = [
        point(1, label="rail", skiltnummer="202"),
        point(2, label="car", skiltnummer="204"),
        point(3, label="rail"),
    ]
    shapes += [point(4, label="car"), point(5, label="thing"), point(6, label="thing")]
    file = read_cvat(maker.cvat(image("1.png", *shapes)).encode(), "a.xml")
    found = gather([(file, WIDE)], rig_from_document(maker.rig(), "car.json"), own)
    assert found.annotations.skiltnummer.tolist() == ["202", "204", "", "", ""]
    assert found.other_objects == {"rail": 14}
    assert found.unmapped == {"thing": 2}
    assert [(s.what, s.count, s.reason) for s in found.skipped] == [("labels", 1, "no road object: 'car'")]


def test_image_has_the_number_of_its_picture(maker: Any) -> None:
    """Where the pictures are files, a name that is none of them is left out and counted."""
    names = ["b/t_1781078399078.jpg", "T_2_png.rf.0a1b2c3d.jpg", "t_3.PNG", "other_4.jpg"]
    text = maker.cvat(*(image(name, point()) for name in names))
    frames = {WIDE: {"t_1781078399078.jpg": 5, "T_2": 6, "t_3": 7}}
    rig = rig_from_document(maker.rig(), "car.json")
    found = gather([(read_cvat(text.encode(), "a.xml"), WIDE)], rig, image_frames=frames)
    assert found.annotations.frame.tolist() == [5, 6, 7]
    assert [(s.count, s.reason) for s in found.skipped] == [
        (1, "image that is not among the drive's pictures")
    ]


def test_long_texts_do_not_widen_every_row(maker: Any) -> None:
    """A label is cut, an id that is too long is none: the arrays stay as wide as texts are."""
    shapes = [
        point(1, label="a" * 10_000),
        point(2, object="b" * 10_000),
        point(3, skiltnummer="202;" * 5_000),
    ]
    found = read(maker, {f"{WIDE}.xml": maker.cvat(image("1.png", *shapes))})
    assert found.annotations.label.dtype.itemsize <= 4 * 200
    assert found.annotations.skiltnummer.dtype.itemsize <= 4 * 200
    assert counts(found.skipped) == {"object id longer than 200 characters": 1}
