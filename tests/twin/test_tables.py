"""Every CSV that people's programs save is read by every reader of tables, and written for one of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from twin.drives.annotations.formats.plain_csv import looks_like_annotations_csv, read_annotations_csv
from twin.drives.frames.stamp_files import names_images, read_image_times, read_timestamps
from twin.drives.track.formats.poses_csv import looks_like_poses, read_poses
from twin.reports.truth import read_truth
from twin.tables import NotTextError, Table, csv_bytes


def _norwegian(text: str, delimiter: str = ";") -> str:
    """As a Norwegian spreadsheet writes it; no text of these tables holds a point."""
    return text.replace(",", delimiter).replace(".", ",").replace("\n", "\r\n")


DIALECTS: dict[str, Callable[[str], bytes]] = {
    "UTF-8": lambda text: text.encode(),
    "UTF-8 with a mark": lambda text: text.encode("utf-8-sig"),
    "Excel, CSV UTF-8": lambda text: _norwegian(text).encode("utf-8-sig"),
    "Excel, CSV": lambda text: _norwegian(text).encode("cp1252"),
    "Excel, Unicode text": lambda text: _norwegian(text, "\t").encode("utf-16"),
    "Excel, big-endian": lambda text: "\ufeff".encode("utf-16-be") + _norwegian(text).encode("utf-16-be"),
    "Excel with sep=": lambda text: ("sep=;\r\n" + _norwegian(text)).encode("cp1252"),
    "Norwegian minus": lambda text: _norwegian(text).replace("-", "\u2212").encode(),
}
T0 = 1_781_078_400_000_000_000
TRUTH = (
    "object,label,easting,northing,height\nBlåbær,skilt,273036.53,7039178.81,96.85\nØst,,-4.5,7039178.5,\n"
)
SIGNS = "frame,label,x_px,y_px,track\n20,Gåfelt,700.5,500.25,a\n21,Gåfelt,701.5,500.75,a\n"
POSES = "time_ns,latitude_deg,longitude_deg,height_m,roll_deg,pitch_deg,heading_deg\n" + "".join(
    f"{T0 + i * 10**8},{63.4 + i * 1e-5:.6f},10.4,80.25,-0.5,0.25,90.5\n" for i in range(3)
)
STAMPS = "frame,time_ns\n" + "".join(f"{i},{T0 + i * 10**8}\n" for i in range(3))
IMAGES = "image,time_ns\n" + "".join(f"å{i},{T0 + i * 10**8}\n" for i in range(3))


def _truth(content: bytes, folder: Path) -> Any:
    (folder / "truth.csv").write_bytes(content)
    return read_truth(folder / "truth.csv")


def _signs(content: bytes, _: Path) -> Any:
    assert looks_like_annotations_csv(content)
    file = read_annotations_csv(content, "signs.csv")
    assert not file.skipped
    return [astuple(shape) for shape in file.shapes]


def _poses(content: bytes, _: Path) -> Any:
    assert looks_like_poses(content)
    found = read_poses(content, "poses.csv")
    assert not found.skipped
    return [column.tolist() for column in astuple(found.track)[:7]]


def _stamps(content: bytes, _: Path) -> Any:
    return read_timestamps(content, "front.csv")[0].tolist()


def _images(content: bytes, _: Path) -> Any:
    assert names_images(content)
    return read_image_times(content, "front.csv")


READERS = {
    "truth": (TRUTH, _truth),
    "annotations": (SIGNS, _signs),
    "poses": (POSES, _poses),
    "frame stamps": (STAMPS, _stamps),
    "image stamps": (IMAGES, _images),
}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_reader_of_tables_takes_every_dialect(tmp_path: Path, reader: str, dialect: str) -> None:
    """The same numbers and the same Norwegian letters, whichever program saved them."""
    text, read = READERS[reader]
    assert read(DIALECTS[dialect](text), tmp_path) == read(text.encode(), tmp_path)


def test_spaces_group_digits_where_no_comma_parts_cells() -> None:
    """A cell that Excel shows as 7 039 178,81 is that number; one with two commas stays no number."""
    table = Table(b"easting;northing\n")
    assert [table.plain(cell) for cell in ("7\u00a0039 178,81", "-4,5", "12.5", "1,039,178")] == [
        *("7039178.81", "-4.5", "12.5"),
        "1.039,178",
    ]


def test_bytes_that_are_no_text_are_refused() -> None:
    """A picture by the name of a table is none."""
    with pytest.raises(NotTextError):
        Table(b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR")


@pytest.mark.parametrize(
    ("cell", "written"),
    [
        ("123456789012", '"=""123456789012"""'),
        ("12345678e101", '"=""12345678e101"""'),
        ("0301", '"=""0301"""'),
        ("5001,5031", '"=""5001,5031"""'),
        ("3f09a1b2c4d5", "3f09a1b2c4d5"),
        ("5001", "5001"),
        ("362.50", "362.50"),
        ("=1+1", "'=1+1"),
        (True, "SANN"),
        (False, "USANN"),
        (0.5, "0,5"),
    ],
)
def test_excel_takes_a_cell_for_what_it_is(cell: object, written: str) -> None:
    """Ids and lists of numbers stay text, truth is Norwegian; and our own reader has the text again."""
    content = csv_bytes(["a"], [{"a": cell}], excel=True)
    assert content.decode("utf-8-sig") == f"a\r\n{written}\r\n"
    (row,) = Table(content).by_name()
    assert row["a"] == (cell if written.startswith('"') else written)


def test_excel_csv_is_read_back_as_it_was_written() -> None:
    """Numbers, empty cells, line breaks and Norwegian letters come home through our own reader."""
    rows = [{"name": "Vær; så\ngod", "x": 1.25, "n": 3}, {"name": "", "x": None, "n": -7}]
    for excel in (False, True):
        content = csv_bytes(["name", "x", "n"], rows, excel=excel)
        assert content.startswith(b"\xef\xbb\xbf") == excel
        table = Table(content)
        found = [(name, table.plain(x), table.plain(n)) for name, x, n in table]
        assert found == [("Vær; så\ngod", "1.25", "3"), ("", "", "-7")]
        assert np.isclose(float(found[0][1]), 1.25)
