"""The sync of a mirror that breaks off, begins anew or is refused, and what readers see then."""

from __future__ import annotations

import json
from datetime import timedelta
from typing import Any

import pytest
from mirror_bench import COUNTRY, KINDS, PLATES, Bench, is_page, nine, visible

from nvdb.area import Area
from nvdb.errors import HttpStatusError
from nvdb.mirror import MassDeletionError, ShortBackfillError
from nvdb.replay import Fault, RequestInfo
from twin.mirror.mirror_tables import StoreMirror


def test_sync_makes_a_fresh_backfill_when_the_feed_is_too_short(bench: Bench) -> None:
    """A mirror that was left alone for too long is fetched anew, and finds what was removed unheard."""
    bench.sync()
    bench.world.remove(505)
    bench.feed_is_too_old()
    report = bench.sync()
    assert (report.mode, nine(report)) == ("backfill", (4, 8))
    bench.faults = lambda info: None
    assert visible(bench.store) == bench.clean()
    assert bench.sync().mode == "changes"


def test_sync_refuses_by_share_in_a_mirror_of_many(bench: Bench, plate: Any) -> None:
    """In a mirror of 500, 25 deletions are 5 % and pass, and 26 do not."""
    for number in range(1000, 1491):
        bench.world.create(96, plate(number))
    bench.sync(page_size=1000)
    for number in range(1000, 1026):
        bench.world.remove(number)
    with pytest.raises(MassDeletionError, match=r"26 of 500 Skiltplate .* 5%"):
        bench.sync()
    bench.world.recreate(1000)
    assert bench.sync().applied.deleted[96] == 25


def test_sync_recovers_when_a_refused_backfill_was_a_fault_of_the_api(bench: Bench) -> None:
    """A backfill that was refused is not taken up again: what the API says by then is what counts."""
    bench.sync()
    old = visible(bench.store)
    hidden = set(PLATES[:5])
    for number in hidden:
        bench.world.remove(number)
    with pytest.raises(MassDeletionError):
        bench.sync(fresh=True)
    for number in hidden:
        bench.world.recreate(number)
    report = bench.sync(fresh=True)
    assert (report.mode, nine(report)) == ("backfill", (4, 9))
    assert visible(bench.store) == bench.clean()
    assert visible(bench.store).keys() == old.keys()


def test_sync_refuses_a_backfill_that_lacks_what_the_api_counts(bench: Bench) -> None:
    """Nine plates of twenty that statistikk counts are no mirror; the next run begins anew."""
    bench.faults = lambda info: (
        Fault("status", status=200, body=b'{"antall": 20}') if info.path.endswith("96/statistikk") else None
    )
    with pytest.raises(ShortBackfillError, match="counts 20 Skiltplate and sent 9"):
        bench.sync()
    assert visible(bench.store) == {}
    assert bench.position() is None
    bench.faults = lambda info: None
    assert bench.sync().mode == "backfill"


def test_sync_tells_of_a_small_difference_to_the_count(bench: Bench, plate: Any) -> None:
    """Fewer objects than the API counts by less than 5 % are a problem in the report, and more are too."""
    for number in range(1000, 1050):
        bench.world.create(96, plate(number))
    for count in (60, 58):
        body = json.dumps({"antall": count}).encode()
        bench.faults = lambda info, body=body: (  # type: ignore[misc]
            Fault("status", status=200, body=body) if info.path.endswith("96/statistikk") else None
        )
        report = bench.sync(fresh=True, page_size=1000)
        assert report.problems == (
            f"The API counts {count} Skiltplate and sent 59: if they should agree, fetch everything anew.",
        )


@pytest.mark.parametrize(
    "answer", [Fault("status", status=404), Fault("status", 200, body=b'{"antall": "x"}')]
)
def test_sync_does_without_the_count(bench: Bench, answer: Fault) -> None:
    """A statistikk that is not there leaves the total unknown, and nothing else."""
    bench.faults = lambda info: answer if info.path.endswith("statistikk") else None
    report = bench.sync()
    assert (report.expected, nine(report), report.problems) == ({95: None, 96: None}, (4, 9), ())


def test_sync_makes_a_new_mirror_of_another_source(bench: Bench) -> None:
    """Positions of one API mean nothing to the other: the mirror is filled anew, beside the old one."""
    other = next(kind for kind in KINDS if kind != bench.kind)
    bench.sync()
    old = visible(bench.store)
    seen: list[bool] = []
    bench.world.on_request = lambda info: seen.append(visible(bench.store) == old)
    report = bench.sync(kind=other)
    assert (report.mode, report.source, all(seen)) == ("backfill", other, True)
    assert visible(bench.store) == bench.clean(other) != old
    assert bench.sync(kind=other).mode == "changes"


def test_sync_makes_a_new_mirror_of_another_area(bench: Bench) -> None:
    """However much of the old mirror goes: another area was asked for."""
    box = Area(bbox=(269_990.0, 7_040_501.5, 270_010.0, 7_040_503.5))
    bench.sync()
    report = bench.sync(area=box)
    assert (report.mode, nine(report)) == ("backfill", (0, 2))
    bench.world.update(505)  # outside
    bench.world.remove(502)
    report = bench.sync(area=box)
    assert (report.mode, nine(report)) == ("changes", (0, 1))
    assert visible(bench.store) == bench.clean(area=box)


def test_sync_resumes_and_asks_only_for_the_rest(bench: Bench, plate: Any) -> None:
    """Wherever a backfill breaks off, the next run goes on from there, also over changes in between."""
    bench.sync()
    n_pages = sum(is_page(info) for info in bench.server.requests)
    for broken_at in (1, 2, 5):
        bench.store = bench.new_store(f"broken-{broken_at}.db")
        n_before = len(bench.server.requests)

        def break_off(
            info: RequestInfo, n_before: int = n_before, broken_at: int = broken_at
        ) -> Fault | None:
            n_asked = sum(is_page(old) for old in bench.server.requests[n_before:])
            return Fault("status", status=403) if is_page(info) and n_asked > broken_at else None

        bench.faults = break_off
        with pytest.raises(HttpStatusError):
            bench.sync()
        assert visible(bench.store) == {}
        bench.faults = lambda info: None
        bench.world.update(501 + broken_at % 9, egenskaper=plate(501)["egenskaper"][:3])
        n_before = len(bench.server.requests)
        assert bench.sync().mode == "resumed"
        n_asked = sum(is_page(info) for info in bench.server.requests[n_before:])
        # A type that was read to its end is asked for what follows its last object.
        assert n_asked <= n_pages - broken_at + 1
        assert visible(bench.store) == bench.clean()


@pytest.mark.parametrize("why", ["area", "source", "feed"])
def test_sync_begins_anew_what_it_cannot_resume(bench: Bench, why: str) -> None:
    """A backfill of another area or source, or one whose feed has ended, is not gone on with."""
    bench.faults = lambda info: Fault("status", status=403) if info.path.endswith("/96") else None
    with pytest.raises(HttpStatusError):
        bench.sync()
    begun = StoreMirror(bench.store).backfill()
    assert begun is not None
    bench.faults = lambda info: None
    other = next(kind for kind in KINDS if kind != bench.kind)
    kind, area = (other if why == "source" else ""), COUNTRY
    if why == "area":
        area = Area(bbox=(269_000.0, 7_040_000.0, 271_000.0, 7_042_000.0))
    elif why == "feed":
        bench.clock.time += timedelta(days=40)
        gone = Fault("status", status=410)
        position = begun.position
        if bench.kind == "uberiket":
            bench.faults = lambda info: gone if info.query.get("start") == position == "0" else None
            bench.world.update(501)  # so that the new position is another
    report = bench.sync(kind=kind, area=area)
    assert (report.mode, nine(report)) == ("backfill", (4, 9))
    bench.faults = lambda info: None
    assert visible(bench.store) == bench.clean(kind, area)
