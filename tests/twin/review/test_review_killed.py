"""The server killed at any answer: none is lost, none doubled."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import requests
import sqlalchemy as sa
from review_browser import Browser, browser_of
from store_rows import row

from twin.store import schema
from twin.store.store import Store
from twin.web import Address

KILLS = int(os.environ.get("TWIN_KILLS", "2"))
A_SERVER = 12
"""Answers between two kills."""
N_FINDINGS = A_SERVER * (KILLS + 1)


def many_findings(path: Path) -> list[str]:
    """Put findings into the store as a match leaves them."""
    rows = [
        row(
            schema.change, change_id=f"{n:012x}", verdict="new", reason="It stands here.", confidence=0.9,
            nvdb_type=95, skiltnummer_seen="202", east_m=270_000.0 + 5.0 * n, north_m=7_041_000.0, terms={},
        )
        for n in range(N_FINDINGS)
    ]  # fmt: skip
    with Store.open(path) as store, store.transaction() as connection:
        connection.execute(sa.delete(schema.change))
        connection.execute(sa.insert(schema.change), rows)
    return [one["change_id"] for one in rows]


@contextmanager
def running(store: Path) -> Iterator[tuple[subprocess.Popen[str], Browser]]:
    """Run ``twin review`` as its own process, and open the address that it prints."""
    command = [sys.executable, "-m", "twin", "review", "--store", str(store), "--no-open", "--by", "kari"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        address, _, token = process.stdout.readline().strip().partition("/?token=")
        host, _, port = address.removeprefix("http://").partition(":")
        yield process, browser_of(Address(host, int(port)), token)
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


@pytest.mark.slow
def test_no_answer_is_lost_or_doubled_when_the_server_is_killed(store: Path) -> None:
    """The page sends what was not answered again, with its key, to the server that runs next."""
    changes, rng = many_findings(store), random.Random(20261122)
    todo = [(change_id, f"key of {change_id}") for change_id in changes]
    for kill in range(KILLS + 1):
        with running(store) as (process, browser):
            try:
                while todo:
                    if kill < KILLS and len(todo) == N_FINDINGS - A_SERVER * kill - 2:
                        # Within one of the next answers: each takes some milliseconds.
                        threading.Timer(rng.uniform(0.0, 0.03), process.kill).start()
                    change_id, key = todo[0]
                    seen = browser.get(f"finding/{change_id}")["revision"]
                    asked = {"change_id": change_id, "answer": "accept", "seen_revision": seen}
                    status, done = browser.post("answer", asked, key)
                    assert (status, done["state"]) == (200, "accept")
                    todo.pop(0)
            except requests.RequestException:
                continue
    assert not todo
    with Store.open(store) as opened:
        entries = opened.rows(sa.select(schema.decision_log.c.change_id).order_by(schema.decision_log.c.id))
    assert [entry["change_id"] for entry in entries] == changes


@pytest.mark.slow
def test_answers_that_come_at_once_are_all_kept(store: Path) -> None:
    """Four reviewers at one server, each key sent twice at the same time."""
    changes = many_findings(store)
    with running(store) as (_, browser):
        seen = {one: browser.get(f"finding/{one}")["revision"] for one in changes}
        failed: list[object] = []

        def work(mine: list[str]) -> None:
            for change_id in mine:
                asked = {"change_id": change_id, "answer": "dismiss", "seen_revision": seen[change_id]}
                status, body = browser.post("answer", asked, f"key of {change_id}")
                if status != 200:
                    failed.append(body)

        threads = [threading.Thread(target=work, args=(changes[n % 4 :: 4],)) for n in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert not failed
    with Store.open(store) as opened:
        assert opened.count(schema.decision_log) == N_FINDINGS


@pytest.mark.slow
def test_ctrl_c_ends_the_page_in_order(store: Path) -> None:
    """Exit code 0: this is how it is ended; one line on stdout, the address."""
    command = [sys.executable, "-m", "twin", "review", "--store", str(store), "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            requests.get(line.strip(), timeout=30)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=300)
        finally:
            process.kill()
    assert (process.returncode, out) == (0, "")
    assert line.startswith("http://127.0.0.1:")
    assert "every answer is in the store" in err
    assert "Traceback" not in err
