"""What a match says that the one before it did not."""

from __future__ import annotations

from pathlib import Path

import sqlalchemy as sa
from command_line import Twin

from twin.matching.news import FACT, Gone, Known, News, OtherVerdict, news_from, news_of
from twin.store import schema
from twin.store.kinds import Verdict
from twin.store.store import Store

V = Verdict


def test_news_pairs_findings_by_id_then_object_then_pole() -> None:
    """A sign that NVDB has got was new and is unchanged; one that moved was unchanged; both once."""
    before = [
        Known("same", V.NEW, 95, None, "d:1"),
        Known("a", V.NEW, 95, None, "d:2"),
        Known("b", V.UNCHANGED, 95, 7, "d:3"),
        Known("c", V.MISSING, 95, 8, None),
        Known("quiet", V.UNCHANGED, 95, 9, "d:9"),
    ]
    now = [
        Known("same", V.NEW, 95, None, "d:1"),
        Known("a2", V.UNCHANGED, 95, 12, "d:2"),
        Known("b2", V.MOVED, 95, 7, "d:3"),
        Known("d", V.NEW, 95, None, "d:4"),
        Known("quiet2", V.NOT_OBSERVABLE, 95, 9, None),
        Known("quiet3", V.UNCHANGED, 95, 10, "d:10"),
    ]
    news = news_of("then", before, now)
    assert news == News(
        "then",
        new=("d",),
        changed=(OtherVerdict("a2", V.UNCHANGED, "a", V.NEW), OtherVerdict("b2", V.MOVED, "b", V.UNCHANGED)),
        gone=(Gone("c", V.MISSING),),
    )
    assert news.change_ids == {"d", "b2"}
    assert news_from(news.to_row()) == news
    assert news_of("now", now, now) == News("now")


def test_match_says_what_is_new_since_the_last_one(twin: Twin, store: Path) -> None:
    """A wider tolerance takes a move back, a drive that is gone takes its findings along; then nothing."""
    last = twin("status", "--store", store, "--json").json["last_match"]["at"]
    moved = twin("match", "--store", store, "--tolerance", 5, "--json").json["news"]
    assert moved["since"] == last
    assert [(one["before"], one["verdict"]) for one in moved["changed"]] == [("moved", "unchanged")]
    assert moved["new"] == moved["gone"] == []
    back = twin("match", "--store", store)
    assert "0 new, 1 with another verdict, 0 gone" in back.err
    assert back.out.count("moved") == 2  # in the count by verdict, and as the one finding that is news
    again = twin("match", "--store", store)
    assert "Nothing new since the match of" in again.err
    assert "Findings" not in again.out
    with Store.open(store) as opened, opened.transaction() as connection:
        new = schema.change.c.verdict == V.NEW
        (gone,) = opened.view(connection).rows(sa.select(schema.change.c.change_id).where(new))
        connection.execute(sa.delete(schema.change).where(new))
        opened.touch(connection)
    found = twin("match", "--store", store, "--json").json["news"]
    assert found["new"] == [gone["change_id"]]
    with Store.open(store) as opened:
        assert opened.fact(FACT) == found


def test_first_match_has_no_news(twin: Twin, synced: Path, sample: Path) -> None:
    """Nothing stood before: everything would be new, and nothing is said to be."""
    drive = sample / "trip_trondheim"
    assert twin("ingest-drive", drive, "--store", synced, "--json").code == 0
    answer = twin("match", "--store", synced, "--json")
    assert answer.json["news"] is None
    assert answer.json["n_open"] > 0
