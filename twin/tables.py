"""Tables as text: every kind of CSV that people's programs save, read in one way; and two kinds written.

A Norwegian Excel parts cells by semicolons, because it writes decimal commas; its "Unicode text" is UTF-16
with tabs, its plain CSV is Windows-1252. Which of these a file is stands in its first bytes and first line.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields

_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_DELIMITERS = ";\t,"
_LONGEST_HEADER = 10_000
_BEGINNING = 1_000
_LIKE_A_NUMBER = re.compile(r"\d{9,}|0\d+|\d+e\d+|\d+,\d+", re.IGNORECASE)
"""Text that Excel would take for a number, and show as another: an id 12345678e101, a list 5001,5031."""
_KEPT_AS_TEXT = re.compile(r'="([^"]*)"')
_SPACES = str.maketrans({"\u00a0": "", "\u202f": "", " ": "", "\u2212": "-"})
"""Between groups of three digits; and the minus sign of a Norwegian locale."""


class NotTextError(ValueError):
    """The file is in none of the encodings in which programs save tables."""


class Table:
    """A table with a header, whatever program saved it; iterate over it once for its rows.

    Parameters
    ----------
    content : bytes
        UTF-8 with or without a byte-order mark, UTF-16 with one, or Windows-1252; cells parted by commas,
        semicolons or tabs. A first line ``sep=;``, which only Excel understands, is taken for that.

    Attributes
    ----------
    header : tuple of str
        Without spaces around; empty of an empty file.
    delimiter : str

    Raises
    ------
    NotTextError
    csv.Error
        Of the header; iterating raises it too.
    """

    def __init__(self, content: bytes) -> None:
        text, self.delimiter = parted(text_of(content))
        self._reader = csv.reader(io.StringIO(text, newline=""), delimiter=self.delimiter)
        self.header = tuple(name.strip() for name in next(self._reader, []))

    def __iter__(self) -> Iterator[list[str]]:
        """Yield the cells of each row, as they stand."""
        return self._reader

    @property
    def line(self) -> int:
        """The line of the file that was read last, counted from 1."""
        return self._reader.line_num

    def by_name(self) -> Iterator[dict[str, str]]:
        """Yield each row that is not empty by the names of its columns; a cell that is not there is empty."""
        for cells in self:
            if any(cell.strip() for cell in cells):
                plain = [_KEPT_AS_TEXT.sub(r"\1", cell.strip()) for cell in cells]
                filled = [*plain, *[""] * (len(self.header) - len(cells))]
                yield dict(zip(self.header, filled, strict=False))

    def plain(self, cell: str) -> str:
        """Return a number with a decimal point, as ``float`` takes it.

        Where commas part no cells one comma is the decimal point, and spaces group digits.

        >>> Table(b"east;north").plain("7 039 178,81")
        '7039178.81'
        """
        if self.delimiter == ",":
            return cell
        cell = cell.strip().translate(_SPACES)
        return cell if "." in cell else cell.replace(",", ".", 1)


def header_of(head: bytes) -> list[str]:
    """Return the names of the columns from the beginning of a file; nonsense where it is no table."""
    head = head[:_LONGEST_HEADER]
    text = head.decode("utf-16" if head.startswith(_UTF16) else "utf-8-sig", errors="replace")
    first, delimiter = parted(text)
    return [name.strip(' "\r') for name in first.partition("\n")[0].split(delimiter)]


def csv_bytes(columns: Sequence[str], rows: Iterable[Mapping[str, object]], *, excel: bool = False) -> bytes:
    """Write a table: comma and point in UTF-8, or as Norwegian Excel opens it by a double click.

    Parameters
    ----------
    columns : sequence of str
        The header, and the keys of the rows.
    rows : iterable of mapping
        None becomes an empty cell. Numbers are to be rounded before.
    excel : bool
        Semicolons, decimal commas, SANN and USANN, ``="12345678e101"`` for text that looks like a number,
        CRLF and a byte-order mark.
    """
    text = io.StringIO()
    out = csv.writer(text, delimiter=";" if excel else ",", lineterminator="\r\n" if excel else "\n")
    out.writerow(columns)
    for row in rows:
        cells = [row[name] for name in columns]
        out.writerow([_for_excel(cell) for cell in cells] if excel else cells)
    return text.getvalue().encode("utf-8-sig" if excel else "utf-8")


def record_row(record: object) -> dict[str, object]:
    """Values of a record (a dataclass) by the names of its fields, numbers to four decimals."""
    values = asdict(record)  # type: ignore[call-overload]
    return {name: round(value, 4) if isinstance(value, float) else value for name, value in values.items()}


def records_csv(kind: type[object], records: Iterable[object], *, excel: bool = False) -> bytes:
    """Write a line a record under the names of its fields; None becomes an empty cell.

    Parameters
    ----------
    kind : type
        The records' dataclass: it has the names where there is no record.
    records : iterable of dataclass
    excel : bool
        As `csv_bytes` takes it.
    """
    return csv_bytes(field_names(kind), map(record_row, records), excel=excel)


def field_names(kind: type[object]) -> list[str]:
    """Names of a dataclass's fields, as the columns of its records."""
    return [field.name for field in fields(kind)]  # type: ignore[arg-type]


def _for_excel(cell: object) -> object:
    """A cell as Norwegian Excel takes it for what it is."""
    if isinstance(cell, bool):
        return "SANN" if cell else "USANN"
    if isinstance(cell, str) and _LIKE_A_NUMBER.fullmatch(cell):
        return f'="{cell}"'
    if isinstance(cell, str) and cell.startswith(("=", "+", "-", "@")):
        # What strangers have written is text, and no formula that Excel would work out.
        return f"'{cell}"
    return str(cell).replace(".", ",") if isinstance(cell, float) else cell


def text_of(content: bytes) -> str:
    """Decode what a program saved as text: UTF-8, UTF-16 with its mark, else Windows-1252.

    Damaged characters are replaced: a reader counts the rows that they spoil.

    Raises
    ------
    NotTextError
        It begins with bytes that no text has.
    """
    if content.startswith(_UTF16):
        text = content.decode("utf-16", errors="replace")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.removeprefix(codecs.BOM_UTF8).decode("cp1252", errors="replace")
    if "\0" in text[:_BEGINNING]:
        raise NotTextError("it begins with bytes that no text has")
    return text


def parted(text: str) -> tuple[str, str]:
    """Return the table without a line ``sep=;``, and what parts its cells."""
    first, end, rest = text.partition("\n")
    told = first.strip().lower()
    if told.startswith("sep=") and len(told) == 5 and end:
        return rest, told[-1]
    if told == "sep=" and end:  # A tab is stripped as a space is.
        return rest, "\t"
    # The first of those that stand most often in the header.
    return text, max(_DELIMITERS, key=first.count)
