"""What twin writes in tables: the layers of an export, the tables of the store, the exit codes."""

from __future__ import annotations

import re

import sqlalchemy as sa

from reference.markdown import code, page, table
from twin.cli import exit_codes
from twin.export.column_meanings import MEANINGS
from twin.export.layers import COLUMNS, GEOMETRY, description
from twin.store import schema

_KINDS = {
    "str": "text",
    "int64": "whole number",
    "Int64": "whole number or null",
    "float64": "number or null",
    "bool": "true or false",
}


def layers_page() -> str:
    """Return docs/reference/layers.md."""
    sections = [
        f"## {layer}\n{description(layer)} Geometry: {GEOMETRY[layer]}.\n\n"
        + table(
            ["column", "kind", "unit", "meaning"],
            [
                [code(one.name), _KINDS.get(one.dtype, "time"), one.unit, MEANINGS[layer].get(one.name, "")]
                for one in columns
            ],
        )
        for layer, columns in COLUMNS.items()
    ]
    return page(
        "Layers of an export",
        "`twin export` writes these into `twin_utm33.gpkg` (EPSG:25833) and `twin_wgs84.gpkg` (EPSG:4326);"
        " `changes.geojson` has the first. [The layers in QGIS](../qgis.md) shows how to use them.",
        *sections,
    )


def store_page() -> str:
    """Return docs/reference/store.md."""
    tables = sorted([*schema.metadata.tables.values(), schema.decision], key=lambda one: one.name)
    copies = [one for one in tables if (one.comment or "").startswith("As ")]
    return page(
        "Tables of the store",
        f"A store is one SQLite file; this is version {schema.VERSION} of its tables. Read it with any tool,"
        " but write to it with `twin` alone. The tables may change with twin;"
        " [layers](layers.md) change less.",
        *(_store_table(one) for one in tables if one not in copies),
        "## Copies\nThese have the columns of the table that they name.\n\n"
        + table(["table", "what", "one more column"], [_copy(one) for one in copies]),
    )


def _store_table(one: sa.Table) -> str:
    rows = [
        [code(column.name), _kind(column), "key" if column.primary_key else "", column.comment or ""]
        for column in one.columns
    ]
    return f"## {one.name}\n{one.comment}\n\n" + table(["column", "kind", "", "meaning"], rows)


def _kind(column: sa.Column[object]) -> str:
    name = type(column.type).__name__
    kind = {
        "String": "text",
        "Float": "number",
        "Boolean": "0 or 1",
        "JSON": "JSON",
        "LargeBinary": "bytes",
    }.get(name, "whole number")
    return kind if column.primary_key or not column.nullable else f"{kind} or null"


def _copy(one: sa.Table) -> list[str]:
    of = re.split(r"[:,]", (one.comment or "").removeprefix("As "))[0]
    more = [column for column in one.columns if column.name not in schema.metadata.tables[of].columns]
    return [code(one.name), one.comment or "", "; ".join(f"{code(c.name)}: {c.comment}" for c in more)]


def exit_code_meanings() -> dict[int, str]:
    """Return exit code → meaning."""
    return {one.code: one.meaning for one in exit_codes.EXIT_CODES}


def exit_codes_page() -> str:
    """Return docs/reference/exit-codes.md."""
    rows = [[str(number), meaning] for number, meaning in exit_code_meanings().items()]
    return page(
        "Exit codes",
        "With which code a command ends, for scripts and timers.",
        table(["code", "meaning"], rows),
    )
