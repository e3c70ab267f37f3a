"""CVAT XML 1.1."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from left_out import counts

from twin.drives.annotations.formats.cvat import is_cvat, read_cvat
from twin.errors import DriveError


def test_cvat_track_point_is_a_foot_half_a_pixel_up_and_left(maker: Any) -> None:
    """CVAT counts from the corner of the first pixel, the twin from its centre."""
    file = read_cvat(
        maker.cvat(maker.track(3, {20: (700.5, 500.5)}, label="202", skiltnummer="202")).encode(), "a.xml"
    )
    (shape,) = file.shapes
    assert (shape.frame, shape.track, shape.label, shape.kind) == (20, "3", "202", "foot")
    assert shape.pixel_px == (700.0, 500.0)
    assert all(math.isnan(edge) for edge in shape.box_px)
    assert shape.attributes == {"skiltnummer": "202"}


@pytest.mark.parametrize(
    ("shape", "pixel", "box"),
    [
        ('<box label="x" xtl="10" ytl="20" xbr="30" ybr="60"/>', (19.5, 39.5), (9.5, 19.5, 29.5, 59.5)),
        # Turned by 90°, width and height change places about the same centre.
        (
            '<box label="x" xtl="10" ytl="20" xbr="30" ybr="60" rotation="90.0"/>',
            *((19.5, 39.5), (-0.5, 29.5, 39.5, 49.5)),
        ),
        # The box around the corners (1, 2), (9, 4) and (5, 8).
        ('<polygon label="x" points="1,2;9,4;5,8"/>', (4.5, 4.5), (0.5, 1.5, 8.5, 7.5)),
    ],
)
def test_cvat_face_has_centre_and_edges(
    maker: Any, shape: str, pixel: tuple[float, ...], box: tuple[float, ...]
) -> None:
    """All minus half a pixel."""
    (face,) = read_cvat(maker.cvat(f'<image id="0" name="1.png">{shape}</image>').encode(), "a.xml").shapes
    assert (face.kind, face.pixel_px) == ("box", pixel)
    assert face.box_px == pytest.approx(box)


def test_cvat_rows_outside_the_view_are_no_annotations(maker: Any) -> None:
    """A track's end is neither a shape nor a loss."""
    file = read_cvat(maker.annotations().encode(), "a.xml")
    assert [shape.frame for shape in file.shapes] == [20, 23, 30]
    assert file.skipped == ()


def test_cvat_shapes_of_other_kinds_are_counted(maker: Any) -> None:
    """Ellipses, polylines, skeletons, tags and points of several points are left out by kind."""
    image = (
        '<image id="0" name="1.png" width="1280" height="800"><ellipse label="a" cx="1" cy="2"/>'
        '<polyline label="a" points="1,2;3,4"/><tag label="a"/><points label="a" points="1,2;3,4;5,6"/>'
        '<skeleton label="a"><points label="1" points="1,1"/><points label="2" points="2,2"/></skeleton>'
        '<box label="a" xtl="5" ytl="5" xbr="5" ybr="9"/><points label="a" points="1"/>'
        '<points label="a" points="nan,1"/><points label="a" points="a,1"/></image>'
    )
    track = (
        '<track id="1" label="a"><skeleton frame="1" outside="0"/><track id="0" label="1">'
        '<points frame="1" outside="0" points="1,1"/></track><track id="1" label="2"/></track>'
        '<track id="2" label="a"><points outside="0" points="1,1"/></track>'
    )
    file = read_cvat(maker.cvat(image, track).encode(), "a.xml")
    assert file.shapes == []
    assert counts(file.skipped) == {
        "kind ellipse": 1,
        "kind polyline": 1,
        "kind tag": 1,
        "kind skeleton": 2,
        "points with 3 points": 1,
        "box without area": 1,
        "coordinates unreadable": 2,
        "coordinates not finite": 1,
        "frame number unreadable": 1,
    }


def test_cvat_skeleton_of_an_image_is_its_foot(maker: Any) -> None:
    """The point that is called so, with what was said of the whole; one that is not seen is left out."""

    def skeleton(outside: int) -> str:
        return (
            '<skeleton label="sign"><attribute name="skiltnummer">202</attribute>'
            '<points label="top" points="1,1"/>'
            f'<points label="Foot" outside="{outside}" points="5.5,9.5"/></skeleton>'
        )

    text = maker.cvat(f'<image id="0" name="1.png">{skeleton(0)}{skeleton(1)}</image>')
    file = read_cvat(text.encode(), "a.xml")
    (shape,) = file.shapes
    assert (shape.kind, shape.label, shape.pixel_px) == ("foot", "sign", (5.0, 9.0))
    assert shape.attributes == {"skiltnummer": "202"}
    assert counts(file.skipped) == {"foot not marked": 1}


def test_cvat_skeleton_of_a_video_is_the_track_of_its_foot(maker: Any) -> None:
    """Label and id are the skeleton's, the attributes those of its row in the same frame."""
    track = (
        '<track id="7" label="sign"><skeleton frame="1" outside="0" points="1,1;5,9">'
        '<attribute name="object">A</attribute></skeleton><skeleton frame="2" outside="0" points="1,1;6,9"/>'
        '<track id="0" label="top"><points frame="1" outside="0" points="1,1"/></track>'
        '<track id="1" label="base"><points frame="1" outside="0" points="5,9"/>'
        '<points frame="2" outside="0" points="6,9"/>'
        '<points frame="3" outside="1" points="6,9"/></track></track>'
    )
    file = read_cvat(maker.cvat(track).encode(), "a.xml")
    assert [(s.frame, s.track, s.label, s.pixel_px) for s in file.shapes] == [
        (1, "7", "sign", (4.5, 8.5)),
        (2, "7", "sign", (5.5, 8.5)),
    ]
    assert [dict(s.attributes) for s in file.shapes] == [{"object": "A"}, {}]
    assert file.skipped == ()


def test_cvat_project_knows_the_names_of_its_tasks(maker: Any) -> None:
    """A project export names the task of each element, and each task its name and image size."""
    meta = "<project><tasks>" + "".join(
        f"<task><id>{i}</id><name>{name}</name><original_size><width>{w}</width><height>800</height>"
        "</original_size></task>"
        for i, name, w in ((4, "trip C3", 1280), (5, "trip C1", 1920))
    )
    tracks = [
        maker.track(i, {1: (5, 5)}).replace("<track ", f'<track task_id="{task}" ')
        for i, task in ((0, 4), (1, 5))
    ]
    file = read_cvat(maker.cvat(*tracks, meta=meta + "</tasks></project>").encode(), "a.xml")
    assert file.tasks == {"4": ("trip C3",), "5": ("trip C1",)}
    assert [shape.size_px for shape in file.shapes] == [(1280, 800), (1920, 800)]


@pytest.mark.parametrize(
    "text",
    [
        '<!DOCTYPE a [<!ENTITY x "y">]><annotations>&x;</annotations>',
        '<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/hostname">]><annotations>&x;</annotations>',
        '<!DOCTYPE annotations SYSTEM "https://127.0.0.1/a.dtd"><annotations/>',
        '<!DOCTYPE a [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]><annotations>&b;</annotations>',
    ],
)
def test_cvat_file_with_entities_is_refused(text: str) -> None:
    """Neither bombs nor outside entities are expanded, and the error names the file."""
    with pytest.raises(DriveError, match=r"a\.xml declares a document type or entities"):
        read_cvat(text.encode(), "a.xml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not well-formed"),
        ("<annotations>", "not well-formed"),
        ("<annotations><image></annotations>", "not well-formed"),
        ('<?xml version="1.0" encoding="klingon"?><annotations/>', "not well-formed"),
        ("<kml/>", "root is <kml>"),
        ("<annotations><version>1.0</version></annotations>", "CVAT XML '1.0'"),
    ],
)
def test_cvat_file_that_is_none_is_refused_by_name(text: str, message: str) -> None:
    """Truncated, foreign and outdated files each get their sentence."""
    with pytest.raises(DriveError, match=message) as caught:
        read_cvat(text.encode(), "a.xml")
    assert "a.xml" in str(caught.value)


def test_cvat_is_told_from_other_xml_by_its_root(maker: Any) -> None:
    """Only the root element counts, a byte order mark and a cut file do not matter."""
    assert is_cvat(maker.annotations().encode())
    assert is_cvat(b"\xef\xbb\xbf" + maker.annotations().encode()[:120])
    assert not is_cvat(b"<kml><annotations/></kml>")
    assert not is_cvat(b"\0\0")
    assert not is_cvat(b"")


NAMES = ["annotations", "image", "track", "points", "box", "skeleton", "meta", "task", "id", "attribute"]
KEYS = ["id", "frame", "points", "xtl", "ytl", "xbr", "ybr", "rotation", "name", "width", "outside", "label"]
VALUES = ["1", "-1", "1,2", "1,2;3,4", "nan", "inf", "", "9" * 30, "1e999", "x", "²"]
words = st.lists(
    st.tuples(
        st.sampled_from(NAMES),
        st.dictionaries(st.sampled_from(KEYS), st.sampled_from(VALUES), max_size=6),
        st.integers(0, 3),
    ),
    max_size=12,
)


def xml(elements: list[tuple[str, dict[str, str], int]]) -> bytes:
    """Nest elements of CVAT's own words: each closes the given number of elements before it opens."""
    text, opened = "<annotations>", []
    for name, attributes, closing in elements:
        for _ in range(min(closing, len(opened))):
            text += f"</{opened.pop()}>"
        text += f"<{name}" + "".join(f' {key}="{value}"' for key, value in attributes.items()) + ">"
        opened.append(name)
    return (text + "".join(f"</{name}>" for name in reversed(opened)) + "</annotations>").encode()


@given(st.binary(max_size=100).map(lambda b: b"<annotations>" + b) | words.map(xml))
def test_cvat_raises_nothing_but_drive_errors(content: bytes) -> None:
    """Whatever the XML: either a DriveError or shapes with finite pixels."""
    try:
        file = read_cvat(content, "a.xml")
    except DriveError:
        return
    for shape in file.shapes:
        assert all(math.isfinite(value) for value in shape.pixel_px)
        assert shape.kind in {"foot", "box"}


def test_cvat_file_cut_anywhere_is_refused(maker: Any) -> None:
    """A cut is never well-formed."""
    content = maker.annotations().encode()
    for end in range(len(content) - 3):
        with pytest.raises(DriveError):
            read_cvat(content[:end], "a.xml")
