"""The paging loop against V4's end, short pages and cursors that go wrong."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nvdb.client import iter_pages
from nvdb.client.paging import MAX_EMPTY_PAGES, follow
from nvdb.errors import PagingError, SchemaError
from nvdb.replay import Fault, RequestInfo

PATH = "/vegobjekter/96"
META = {"inkluder": "metadata"}


def _ids(pages: Any) -> list[int]:
    return [item["id"] for page in pages for item in page.objects]


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    max_examples=25,
    deadline=None,
    derandomize=True,
    database=None,
)
@given(n=st.integers(0, 12), size=st.integers(1, 14))
def test_paging_gives_every_object_once_whatever_the_page_size(
    api: Any, plate: Any, n: int, size: int
) -> None:
    """N objects in pages of any size come in order, each once, in as many pages as they fill."""
    client, server = api.serve({96: [plate(500 + number) for number in range(n)]})
    pages = list(iter_pages(client, PATH, {"antall": size}))
    assert _ids(pages) == [500 + number for number in range(n)]
    assert len(pages) == -(-n // size)
    # The end is learnt from one more, empty page.
    assert len(server.requests) == len(pages) + 1


def test_paging_hands_out_cursors_that_lead_on(api: Any, plate: Any) -> None:
    """A page's next_cursor is where another loop goes on, without loss or repetition."""
    client, _ = api.serve({96: [plate(number) for number in range(501, 508)]})
    first, second, third = iter_pages(client, PATH, META | {"antall": 3})
    assert (first.cursor, first.next_cursor) == (None, "503:2")
    assert (second.cursor, second.next_cursor) == ("503:2", "506:2")
    assert _ids(iter_pages(client, PATH, META | {"antall": 3}, start=first.next_cursor)) == [
        504,
        505,
        506,
        507,
    ]
    assert third.next_cursor is not None
    assert list(iter_pages(client, PATH, META, start=third.next_cursor)) == []


def test_paging_of_a_query_without_hits_gives_no_page(api: Any, plate: Any) -> None:
    """An empty page without ``neste`` is the end after one request."""
    client, server = api.serve({96: [plate(501)]})
    assert list(iter_pages(client, PATH, {"kommune": "301"})) == []
    assert len(server.requests) == 1


def _answers(*pages: Any) -> Any:
    """A fault for each request that is really a made-up page; the last one is repeated."""

    def choose(request: RequestInfo) -> Fault:
        page = pages[min(request.number, len(pages) - 1)]
        return Fault("status", status=200, body=json.dumps(page).encode())

    return choose


def _page(ids: list[int], start: object) -> dict[str, Any]:
    neste = (
        {} if start is None else {"neste": {"start": start, "href": "http://elsewhere.invalid/vegobjekter"}}
    )
    return {"objekter": [{"id": number} for number in ids], "metadata": {"returnert": len(ids), **neste}}


def test_paging_does_not_take_a_short_page_for_the_last(api: Any) -> None:
    """Pages are limited by size too: 2, 1 and 2 objects for antall=2 are all read; no href is followed."""
    client, server = api.serve(
        {96: []}, _answers(_page([1, 2], "2:1"), _page([3], "3:1"), _page([4, 5], "5:1"), _page([], "5:1"))
    )
    assert _ids(iter_pages(client, PATH, {"antall": 2})) == [1, 2, 3, 4, 5]
    assert [request.query.get("start") for request in server.requests] == [None, "2:1", "3:1", "5:1"]


def test_paging_stops_where_a_page_names_no_next(api: Any) -> None:
    """A page with objects and without ``neste`` (documented for single objects) is the last."""
    client, server = api.serve({96: []}, _answers(_page([1, 2], None)))
    assert _ids(iter_pages(client, PATH)) == [1, 2]
    assert len(server.requests) == 1


@pytest.mark.parametrize(
    "pages",
    [
        (_page([1, 2], "2:1"), _page([3], "2:1")),
        (_page([1, 2], "2:1"), _page([1, 2], "9:1")),
        (_page([1], "a"), _page([2], "b"), _page([3], "a")),
    ],
    ids=["cursor repeated", "page repeated", "cursor cycle"],
)
def test_paging_refuses_to_go_in_a_circle(api: Any, pages: Any) -> None:
    """A page with objects that leads back is an error: to stop there would lose what follows."""
    client, _ = api.serve({96: []}, _answers(*pages))
    with pytest.raises(PagingError, match="leads back"):
        list(iter_pages(client, PATH))


def _bare(ids: list[int], start: str) -> dict[str, Any]:
    """A page of objects that have neither id nor version, but a `ref`."""
    return _page([], start) | {"objekter": [{"ref": number} for number in ids]}


def test_paging_tells_objects_without_id_apart_by_their_key(api: Any) -> None:
    """Full pages of objects without an id are all read with a key, and one that comes again is found."""
    pages = (_bare([1, 2], "a"), _bare([3, 4], "b"), _bare([], "b"))
    client, _ = api.serve({96: []}, _answers(*pages))
    read = iter_pages(client, PATH, key=lambda item: item["ref"])
    assert [item["ref"] for page in read for item in page.objects] == [1, 2, 3, 4]

    client, _ = api.serve({96: []}, _answers(_bare([1, 2], "a"), _bare([1, 2], "b")))
    with pytest.raises(PagingError, match="leads back"):
        list(iter_pages(client, PATH, key=lambda item: item["ref"]))


def test_paging_takes_a_new_version_for_another_object(api: Any) -> None:
    """The same id with another version is not a page that came again."""
    first, second = _page([1], "1:1"), _page([1], "1:2")
    first["objekter"][0]["metadata"] = {"versjon": 1}
    second["objekter"][0]["metadata"] = {"versjon": 2}
    client, _ = api.serve({96: []}, _answers(first, second, _page([], "1:2")))
    assert _ids(iter_pages(client, PATH)) == [1, 1]


@pytest.mark.parametrize("first", [0, 1], ids=["first page", "second page"])
def test_paging_finds_a_repeated_cursor_of_the_server(api: Any, plate: Any, first: int) -> None:
    """The server's fault of repeating a cursor is found on the first page and on later ones."""
    faults = [None] * first + [Fault("repeat_cursor")]
    client, _ = api.serve({96: [plate(number) for number in range(501, 508)]}, faults)
    with pytest.raises(PagingError):
        list(iter_pages(client, PATH, META | {"antall": 3}))


@pytest.mark.parametrize("start", [None, "503:2"], ids=["from the beginning", "resumed"])
@pytest.mark.parametrize("empty", [{0}, {1}, {0, 2}, {1, 3, 5}], ids=str)
def test_paging_goes_on_after_an_empty_page_that_leads_on(
    api: Any, plate: Any, empty: set[int], start: str | None
) -> None:
    """Pages may come empty at the beginning, in the middle and before the last: no object is lost."""
    client, _ = api.serve(
        {96: [plate(number) for number in range(501, 511)]},
        lambda info: Fault("empty_page") if info.number in empty else None,
    )
    first = 501 if start is None else 504
    assert _ids(iter_pages(client, PATH, META | {"antall": 3}, start)) == list(range(first, 511))


def test_paging_ends_a_row_of_empty_pages_that_never_ends() -> None:
    """Empty pages that lead on for ever are an error; the count begins anew with each page that is not."""

    def ask(cursor: str | None) -> tuple[int, list[dict[str, Any]], str]:
        number = int(cursor or 0)
        items = [{"id": number}] if number == MAX_EMPTY_PAGES - 1 else []
        return number, items, str(number + 1)

    pages = follow(ask, None, PATH)
    assert next(pages) == (MAX_EMPTY_PAGES - 1, str(MAX_EMPTY_PAGES))
    with pytest.raises(PagingError, match="2,000 pages of /vegobjekter/96 in a row are empty"):
        next(pages)


@pytest.mark.parametrize(
    ("body", "named"),
    [
        ([], "objekter"),
        ({"metadata": {}}, "objekter"),
        ({"objekter": {}, "metadata": {}}, "objekter"),
        ({"objekter": []}, "metadata"),
        ({"objekter": [1], "metadata": {}}, "objekter"),
        ({"objekter": [], "metadata": {"neste": {"start": 7}}}, "neste.start"),
    ],
)
def test_paging_names_what_a_page_lacks(api: Any, body: Any, named: str) -> None:
    """A page that is not V4's is a SchemaError that names the field."""
    client, _ = api.serve({96: []}, _answers(body))
    with pytest.raises(SchemaError, match=named):
        list(iter_pages(client, PATH))
