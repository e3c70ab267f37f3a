"""How soon signs are taken down, by class: from what the mirror's history says that NVDB closed."""

from __future__ import annotations

import pytest
import sqlalchemy as sa
from store_rows import row

from twin.belief.lifetimes import PRIOR_EVENTS, fitted, lifetimes_of, sign_class
from twin.store import schema
from twin.store.store import Store


def test_a_class_is_drawn_towards_all_and_all_towards_what_is_stated() -> None:
    """Gamma prior of five events: 100 closed in 1,000 years stay nearly 10 %, one in ten years does not."""
    life = fitted({"3": (100, 1000.0), "7": (1, 10.0)}, 0.02)
    every = (101 + PRIOR_EVENTS) / (1010 + PRIOR_EVENTS / 0.02)
    assert life.every.per_year == pytest.approx(every)
    assert life.per_year("3") == pytest.approx((100 + PRIOR_EVENTS) / (1000 + PRIOR_EVENTS / every))
    assert abs(life.per_year("7") - every) < 0.3 * every
    assert life.per_year("9") == every
    assert fitted({}, 0.02).per_year("3") == pytest.approx(0.02)


def test_sign_class_is_the_first_digit_of_the_upper_plate() -> None:
    """Retired codes count as those that they replaced."""
    assert [sign_class(codes) for codes in (("362.50", "802"), ("U142",), ())] == ["3", "1", ""]


def test_the_mirrors_history_tells_what_nvdb_closed(empty: Store) -> None:
    """Closed signs count once; not what was registered anew, nor what went with another area's mirror."""
    began, now = "2024-01-01T00:00:00Z", "2026-01-01T00:00:00Z"

    def point(nvdb_id: int, plate: int, east_m: float, **more: object) -> dict[str, object]:
        told = {"nvdb_id": nvdb_id, "plate_ids": [plate], "east_m": east_m, "north_m": 0.0}
        return dict(row(schema.skiltpunkt, synced_at=began, **told)) | more

    history = schema.MIRROR[95].history
    closed = [
        point(1, 11, 0.0, seen_until="2025-01-01T00:00:00Z", end_date="2024-12-31"),
        # Changed before it was closed: one sign, one end.
        point(2, 12, 50.0, seen_until="2024-06-01T00:00:00Z"),
        point(2, 12, 50.0, seen_until="2025-07-01T00:00:00Z", synced_at="2024-06-01T00:00:00Z"),
        # Registered anew under another id at the same place.
        point(3, 13, 100.0, seen_until="2025-03-01T00:00:00Z"),
        # Of another area, which this one took the place of.
        point(4, 14, 150.0, seen_until=began),
    ]
    standing = [point(5, 15, 100.5, synced_at="2025-03-05T00:00:00Z"), point(6, 16, 200.0)]
    plates = {11: "362.50", 12: "142", 13: "362.50", 14: "362.50", 15: "362.50", 16: "362.60"}
    with empty.transaction() as connection:
        connection.execute(sa.insert(history), closed)
        connection.execute(sa.insert(schema.skiltpunkt), standing)
        for nvdb_id, code in plates.items():
            connection.execute(
                sa.insert(schema.skiltplate), row(schema.skiltplate, nvdb_id=nvdb_id, skiltnummer=code)
            )
        empty.put_fact(connection, "mirror", {"since": began, "synced_at": now})
    with empty.snapshot() as view:
        life = lifetimes_of(view, 0.02)
    assert {name: one.closed for name, one in life.classes.items()} == {"3": 1, "1": 1}
    assert life.classes["1"].years == pytest.approx(1.5, abs=0.01)
    assert life.classes["3"].years == pytest.approx(1.0 + 1.16 + 0.83 + 2.0, abs=0.02)
    assert life.every.closed == 2
