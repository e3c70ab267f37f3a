"""Fetching the segmented network, from a server that pages as API Les V4 does."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from datetime import date
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from vegnett_links import link_in_oslo

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.errors import PagingError, SchemaError
from nvdb.vegnett import SEGMENTERT, Vegnett, hent_vegnett

OSLO = Area(kommuner=(301,))


class _Vegnett(ThreadingHTTPServer):
    """Serves `links` in pages; `broken` turns the cursor back to the start, `stuck` repeats page one."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.links: list[dict[str, Any]] = []
        self.queries: list[dict[str, str]] = []
        self.paths: list[str] = []
        self.broken = self.stuck = False

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"

    def page(self, query: dict[str, str]) -> dict[str, Any]:
        start, antall = int(query.get("start", 0)), int(query["antall"])
        links = self.links[:antall] if self.stuck else self.links[start : start + antall]
        following = str(0 if self.broken else start + len(links))
        metadata: dict[str, Any] = {"returnert": len(links), "sidestørrelse": antall}
        if links or "start" in query:  # V4 names no cursor where nothing is found at all
            metadata["neste"] = {"start": following, "href": f"{self.url}{SEGMENTERT}?start={following}"}
        return {"objekter": links, "metadata": metadata}


class _Handler(BaseHTTPRequestHandler):
    server: _Vegnett

    def do_GET(self) -> None:
        parts = urlsplit(self.path)
        query = {name: values[0] for name, values in parse_qs(parts.query).items()}
        self.server.paths.append(parts.path)
        self.server.queries.append(query)
        body = json.dumps(self.server.page(query)).encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *args: Any) -> None:
        """Say nothing."""


@pytest.fixture
def server() -> Iterator[_Vegnett]:
    """A server on loopback."""
    with _Vegnett() as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def client(server: _Vegnett) -> Iterator[NvdbClient]:
    """A client of it that never waits."""
    with NvdbClient(server.url, timeout_s=5.0, sleep=lambda _: None) as client:
        yield client


def test_hent_vegnett_brings_every_link_once(server: _Vegnett, client: NvdbClient) -> None:
    """Seven links in pages of two arrive once each, although links have no id to tell full pages apart by."""
    server.links = [link_in_oslo(number) for number in range(7)]
    pages = list(hent_vegnett(client, OSLO, antall=2))
    assert [len(page.objects) for page in pages] == [2, 2, 2, 1]
    nett = Vegnett.from_les_v4(link for page in pages for link in page.objects)
    assert nett.veglenkesekvensid.tolist() == [5000 + number for number in range(7)]
    assert nett.rejected == ()


def test_hent_vegnett_asks_for_utm33_and_the_area(server: _Vegnett, client: NvdbClient) -> None:
    """The question names the system, the kommune or the box, and the day if one is given."""
    list(hent_vegnett(client, OSLO))
    box = Area(bbox=(265_273.0, 7_019_372.0, 346_553.0, 7_061_071.0))
    list(hent_vegnett(client, box, tidspunkt=date(2024, 6, 1), historisk=True, antall=10))
    assert server.paths == [SEGMENTERT, SEGMENTERT]
    assert server.queries == [
        {"srid": "5973", "antall": "1000", "kommune": "301"},
        {
            "srid": "5973",
            "antall": "10",
            "kartutsnitt": "265273.000,7019372.000,346553.000,7061071.000",
            "tidspunkt": "2024-06-01",
            "historisk": "true",
        },
    ]


def test_hent_vegnett_goes_on_from_a_saved_cursor(server: _Vegnett, client: NvdbClient) -> None:
    """What follows a page's next_cursor is the rest, without loss or repetition."""
    server.links = [link_in_oslo(number) for number in range(5)]
    first = next(hent_vegnett(client, OSLO, antall=2))
    rest = hent_vegnett(client, OSLO, antall=2, start=first.next_cursor)
    assert [link["veglenkesekvensid"] for page in rest for link in page.objects] == [5002, 5003, 5004]


def test_hent_vegnett_notices_a_cursor_that_leads_back(server: _Vegnett, client: NvdbClient) -> None:
    """A page that comes again is an error: whatever follows it would be lost."""
    server.links, server.broken = [link_in_oslo(number) for number in range(4)], True
    with pytest.raises(PagingError):
        list(hent_vegnett(client, OSLO, antall=2))


def test_hent_vegnett_notices_a_page_that_comes_again(server: _Vegnett, client: NvdbClient) -> None:
    """The same links under a new cursor are an error: the links' references tell."""
    server.links, server.stuck = [link_in_oslo(number) for number in range(4)], True
    with pytest.raises(PagingError):
        list(hent_vegnett(client, OSLO, antall=2))


def test_hent_vegnett_hands_out_links_as_received(server: _Vegnett, client: NvdbClient) -> None:
    """Nothing is added to a link to page through them."""
    server.links = [link_in_oslo(number) for number in range(3)]
    assert [link for page in hent_vegnett(client, OSLO, antall=2) for link in page.objects] == server.links


def test_hent_vegnett_refuses_what_is_not_a_page(server: _Vegnett, client: NvdbClient) -> None:
    """An answer whose objects are no objects is named for what it is."""
    server.links = ["not a link"]  # type: ignore[list-item]  # on purpose
    with pytest.raises(SchemaError, match="objekter"):
        list(hent_vegnett(client, OSLO))
