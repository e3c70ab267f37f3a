"""Sign faces: each code of the catalogue has one, and page and renderer draw from the same shapes."""

from __future__ import annotations

from collections import Counter
from xml.etree import ElementTree as ET

import numpy as np

from nvdb.datakatalog import SKILTNUMMER_ENUM
from twin.drawings import face, painted, svg
from twin.drawings.shapes import Text
from twin.samples.sample_nvdb import CODE_NAMES, TEXTS

MORE = ("100.2", "110", "206", "214", "904.V", "990", "999", "U362.60", "", "Q")
CODES = (*SKILTNUMMER_ENUM, *CODE_NAMES, *MORE)
PLAIN_XML = {"svg", "polygon", "polyline", "circle", "text"}


def test_every_code_has_a_face_within_its_plate() -> None:
    """The picture is well-formed, of shapes alone, and nothing is painted beyond the plate's own box."""
    for code in sorted(set(CODES)):
        root = ET.fromstring(svg(code))
        assert {element.tag.rpartition("}")[2] for element in root.iter()} <= PLAIN_XML, code
        # The page's CSP refuses styles.
        assert not any("style" in element.attrib for element in root.iter()), code
        sign = face(code)
        low, high = np.min(sign.outline, axis=0) - 0.5, np.max(sign.outline, axis=0) + 0.5
        for one in painted(sign):
            points = np.concatenate(one.rings)
            assert np.all(points >= low), code
            assert np.all(points <= high), code


def test_the_commonest_codes_are_drawn_and_not_written() -> None:
    """No sign of the sample is its number in a frame, and each looks unlike the others."""
    drawn = {code: svg(code, TEXTS.get(code, "")).replace(f'"{code}"', "") for code in CODE_NAMES}
    assert [code for code, picture in drawn.items() if f">{code}<" in picture] == []
    assert [n for n in Counter(drawn.values()).values() if n > 1] == []


def test_an_unknown_code_is_written_in_the_shape_of_its_family() -> None:
    """A new warning sign is still a red triangle, and says which."""
    sign = face("199.7")
    assert sign.outline == face("142").outline
    assert [shape.words for shape in sign.shapes if isinstance(shape, Text)] == ["199.7"]


def test_texts_are_written_and_cannot_break_out() -> None:
    """What stands on the plate is shown as it is, also where somebody wrote markup into NVDB."""
    assert ">150 m<" in svg("802", "150 m")
    hostile = ET.fromstring(svg('8"><script>x</script>', "<script>alert(1)</script>"))
    assert not [element for element in hostile.iter() if element.tag.endswith("script")]


def test_letters_keep_their_holes_and_their_room() -> None:
    """The zeros of 100 are rings within rings, and the number stays inside the ring of the sign."""
    number = painted(face("362.100"))[-1]
    points = np.concatenate(number.rings)
    assert len(number.rings) == 5
    assert np.hypot(*(points - 50.0).T).max() < 39.0
