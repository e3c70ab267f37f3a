"""Types of columns that mean the same in SQLite and in PostgreSQL."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql


class _NullForNaN(sa.types.TypeDecorator[float]):
    impl = sa.Float
    cache_ok = True

    def process_bind_param(self, value: Any, _dialect: Any) -> Any:
        return None if value is not None and value != value else value  # noqa: PLR0124  (NaN)


REAL = sa.Float().with_variant(_NullForNaN(), "postgresql")
"""A float of 64 bits. NaN becomes NULL, as in SQLite; PostgreSQL would keep it as a number."""

TEXT = sa.String().with_variant(sa.String(collation="C"), "postgresql")
"""Texts that compare by their bytes: what is sorted comes out the same from every database and machine."""

JSON = sa.JSON().with_variant(postgresql.JSONB(), "postgresql")
JSON_OR_NULL = sa.JSON(none_as_null=True).with_variant(postgresql.JSONB(none_as_null=True), "postgresql")
"""As `JSON`; None is no document."""

ROWID = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
"""An id that SQLite keeps rows by: INTEGER PRIMARY KEY needs no index of its own, BIGINT would."""
