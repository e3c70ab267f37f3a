"""What pages hear of a drive over WebSocket: what holds, what changes, and strangers nothing."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from http.client import HTTPConnection

import pytest
from live_lines import estimate
from websockets.exceptions import ConnectionClosedOK, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from twin.live.car_state import CarState
from twin.live.estimates import State
from twin.live.sinks import Pages
from twin.web import listening


@pytest.fixture
def pages() -> Iterator[Pages]:
    """A server of its own."""
    one = Pages(*listening())
    yield one
    one.close()


def address(pages: Pages, *, token: bool = True) -> str:
    """Where it is listened to."""
    host, _, query = pages.url.removeprefix("http://").partition("/?")
    return f"ws://{host}/live" + (f"?{query}" if token else "")


def cookie(pages: Pages) -> str:
    """What a browser gets that shows the token."""
    host, _, query = pages.url.removeprefix("http://").partition("/?")
    connection = HTTPConnection(host, timeout=30)
    connection.request("GET", f"/?{query}")
    answer = connection.getresponse().headers["Set-Cookie"]
    connection.close()
    return str(answer).partition(";")[0]


def heard(client: ClientConnection, n: int) -> list[tuple[str, str]]:
    """The next so many lines: of what, and how far it has come."""
    features = [json.loads(client.recv(timeout=30)) for _ in range(n)]
    return [(one["id"], one["properties"].get("state", "")) for one in features]


def test_who_comes_later_hears_what_holds_and_then_what_changes(pages: Pages) -> None:
    """One line each: what was replaced is not told again."""
    for one in (
        estimate("P1", State.FIRST),
        CarState(10**18),
        estimate("P2", State.FIRST),
        estimate("P1", State.FINAL),
    ):
        pages.write(one)
    with connect(address(pages)) as client:
        assert heard(client, 3) == [("car", ""), ("P2", "first"), ("P1", "final")]
        pages.write(estimate("P2", State.REFINED))
        assert heard(client, 1) == [("P2", "refined")]


def test_strangers_hear_nothing(pages: Pages) -> None:
    """A page needs the cookie and its own Origin, a program the token, both the server's own name."""
    mine = cookie(pages)
    own = {"origin": pages.name, "additional_headers": {"Cookie": mine}}
    with connect(address(pages, token=False), **own) as client:
        pages.write(estimate("P1", State.FIRST))
        assert heard(client, 1) == [("P1", "first")]
    strangers = (
        {},
        {"additional_headers": {"Cookie": mine}},
        {"origin": "https://evil.example", "additional_headers": {"Cookie": mine}},
        {"origin": pages.name},
    )
    for one in strangers:
        with pytest.raises(InvalidStatus, match="403"):
            connect(address(pages, token=False), **one)
    with pytest.raises(InvalidStatus, match="403"):
        connect(address(pages), origin="https://evil.example")
    with pytest.raises(InvalidStatus, match="403"):
        connect(address(pages).replace("127.0.0.1", "[::ffff:127.0.0.1]"))


@pytest.mark.slow
def test_a_browser_that_reads_nothing_holds_up_nobody(pages: Pages) -> None:
    """Its lines wait in a queue that is bounded, finals in front; another browser hears all meanwhile."""
    with connect(address(pages), max_queue=1) as stuck, connect(address(pages)) as other:
        began_s = time.monotonic()
        for i in range(5000):
            pages.write(estimate("P1", State.REFINED, label="x" * 4000))
            if i % 500 == 0:
                pages.write(estimate(f"F{i}", State.FINAL))
                while heard(other, 1) != [(f"F{i}", "final")]:
                    pass
        assert time.monotonic() - began_s < 60.0
        found = [json.loads(stuck.recv(timeout=30))["id"] for _ in range(3000)]
        assert {f"F{i}" for i in range(0, 5000, 500)} <= set(found)


def test_the_end_is_told(pages: Pages) -> None:
    """What was said last arrives before the server closes."""
    with connect(address(pages)) as client:
        pages.write(estimate("P1", State.FINAL))
        pages.close()
        assert heard(client, 1) == [("P1", "final")]
        with pytest.raises(ConnectionClosedOK):
            client.recv(timeout=30)
