"""A list of findings as a file: CSV, a spreadsheet, or points on a map."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from io import BytesIO
from typing import Any

from twin.reports.finding_list import FindingRow
from twin.tables import csv_bytes
from twin.words import Lang, decision_title, nvdb_type_title, say, verdict_title

COLUMNS = tuple(field.name for field in fields(FindingRow))
_WIDTHS = {"sign": 40, "road": 24, "street": 24, "drives": 24, "seen": 40, "reason": 100}
_USUAL_WIDTH = 14


def csv_of(rows: Sequence[FindingRow], *, excel: bool = False) -> bytes:
    """Write a line a finding under the names of `FindingRow`; `excel` as :func:`twin.tables.csv_bytes`."""
    return csv_bytes(COLUMNS, (asdict(row) for row in rows), excel=excel)


def geojson_of(rows: Sequence[FindingRow]) -> bytes:
    """Write points as RFC 7946 wants them: WGS84, longitude first, an id on every feature; one a line."""
    features = []
    for row in rows:
        properties = asdict(row)
        place = [properties.pop("longitude_deg"), properties.pop("latitude_deg")]
        geometry = {"type": "Point", "coordinates": place}
        feature = {"type": "Feature", "id": row.change_id, "geometry": geometry, "properties": properties}
        features.append(json.dumps(feature, ensure_ascii=False, allow_nan=False))
    body = ",\n".join(features)
    return f'{{"type": "FeatureCollection", "features": [\n{body}\n]}}\n'.encode()


def xlsx_of(rows: Sequence[FindingRow], lang: Lang = Lang.EN) -> bytes:
    """Write a sheet for people: headings and verdicts in their language, a filter, the header in view."""
    from xlsxwriter import Workbook

    file = BytesIO()
    # What strangers have written on a sign is text, whatever it begins with.
    options = {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False}
    with Workbook(file, options) as book:
        sheet = book.add_worksheet(say(lang, "findings.sheet"))
        bold = book.add_format({"bold": True, "bottom": 1})
        share = book.add_format({"num_format": "0.00%"})
        sheet.write_row(0, 0, [say(lang, f"findings.{name}") for name in COLUMNS], bold)
        for number, row in enumerate(rows, start=1):
            for column, (name, value) in enumerate(asdict(row).items()):
                if name == "confidence":
                    sheet.write_number(number, column, value, share)
                elif value is not None:
                    sheet.write(number, column, _told(name, value, lang))
        for column, name in enumerate(COLUMNS):
            sheet.set_column(column, column, _WIDTHS.get(name, _USUAL_WIDTH))
        sheet.autofilter(0, 0, len(rows), len(COLUMNS) - 1)
        sheet.freeze_panes(1, 1)
    return file.getvalue()


def _told(name: str, value: Any, lang: Lang) -> Any:
    if name == "verdict":
        return verdict_title(value, lang)
    if name == "decision":
        return decision_title(value, lang)
    if name == "nvdb_type":
        return nvdb_type_title(value)
    if name == "is_new":
        return say(lang, "findings.yes") if value else ""
    return value
