"""Findings that a sync or an ingest overtook are not decided about."""

from __future__ import annotations

from contextlib import AbstractContextManager

import pytest
import sqlalchemy as sa

from twin.decisions.findings import latest_findings
from twin.decisions.log import all_entries
from twin.decisions.record import decide
from twin.errors import RefusedError
from twin.store.store import Store


def test_decide_takes_no_finding_that_went_stale_a_moment_ago(
    opened: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A sync that ends just before the decision is written makes it refuse."""
    change_id = latest_findings(opened.rows)[0].change_id
    transaction = Store.transaction

    def after_a_sync(store: Store) -> AbstractContextManager[sa.Connection]:
        with transaction(store) as connection:
            store.touch(connection)
        return transaction(store)

    monkeypatch.setattr(Store, "transaction", after_a_sync)
    with pytest.raises(RefusedError, match="has changed since the last match"):
        decide(opened, [change_id], "accept", by="kari")
    assert all_entries(opened.rows) == []
