"""Rows of the store's tables."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

EMPTY = {sa.JSON: [], sa.LargeBinary: b"", sa.String: "", sa.Float: 0.0, sa.Boolean: False, sa.Integer: 0}


def row(table: sa.Table, **values: Any) -> dict[str, Any]:
    """Make a row with something in every column that must not be null."""
    made = {}
    for column in table.columns:
        kind = next(kind for kind in EMPTY if isinstance(column.type, kind))
        made[column.name] = None if column.nullable else EMPTY[kind]
    return {**made, **values}
