"""The findings of a match into the store, in one transaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sqlalchemy as sa

from twin.decisions.reopen import reopen_changed
from twin.store import schema
from twin.store.records import Finding
from twin.store.store import Row, Store, utc_now


def save_changes(store: Store, findings: Sequence[Finding], pole_keys: Mapping[str, str], run: Row) -> None:
    """Replace the findings of the last match, in one transaction.

    Findings that were decided on other evidence are open again (:mod:`twin.decisions.reopen`).

    Parameters
    ----------
    findings : sequence of Finding
    pole_keys : mapping of estimate (``drive:object``) to the key of its pole
    run : JSON object
        Facts of the match, with the store's ``revision`` that it is of; without one it is that of now.
    """
    with store.transaction() as connection:
        connection.execute(sa.delete(schema.change))
        if findings:
            connection.execute(sa.insert(schema.change), [finding.to_row() for finding in findings])
        if pole_keys:
            connection.execute(
                sa.insert(schema.pole_key).prefix_with("OR REPLACE"),
                [{"member": member, "pole": pole} for member, pole in pole_keys.items()],
            )
        reopen_changed(connection, utc_now())
        store.put_fact(connection, "last_match", {"revision": store.view(connection).revision(), **run})
