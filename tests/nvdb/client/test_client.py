"""The client against every fault, on real sockets."""

from __future__ import annotations

import json
import socket
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import Any

import pytest
import requests
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from nvdb.client import NvdbClient, answers
from nvdb.client.client import LOW_BUDGET_PAUSE_S, RETRY_AFTER_CAP_S
from nvdb.errors import (
    BodyError,
    ConnectionFailedError,
    DeadlineExceededError,
    HttpStatusError,
    NotJsonError,
    NvdbError,
    RateLimitedError,
    RequestError,
    TransportError,
    TruncatedBodyError,
)
from nvdb.replay import Fault

steady = settings(
    deadline=None, derandomize=True, database=None, suppress_health_check=[HealthCheck.too_slow]
)
PATH = "/vegobjekter/96"


def test_client_sends_the_headers_that_v4_asks_for(api: Any, source: Any) -> None:
    """Every request carries X-Client, X-Kontaktperson and Accept."""
    client, server = api.serve(source, client_name="sign-test", contact="a@b.no")
    client.get_json(PATH)
    headers = server.requests[0].headers
    assert (headers["X-Client"], headers["X-Kontaktperson"]) == ("sign-test", "a@b.no")
    assert headers["Accept"] == "application/json"


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        (Fault("status", status=500), HttpStatusError),
        (Fault("status", status=503), HttpStatusError),
        (Fault("status", status=429), RateLimitedError),
        (Fault("status", status=408), HttpStatusError),
        (Fault("truncate"), TruncatedBodyError),
        (Fault("cut"), TruncatedBodyError),
        (Fault("html_200"), NotJsonError),
        (Fault("garbage"), NotJsonError),
        (Fault("damaged_gzip"), TruncatedBodyError),
        (Fault("disconnect"), ConnectionFailedError),
    ],
    ids=lambda value: f"{value.kind}-{value.status}" if isinstance(value, Fault) else "",
)
def test_client_outlives_a_passing_fault_and_names_a_lasting_one(
    api: Any, source: Any, fault: Fault, kind: type[TransportError]
) -> None:
    """Two faults in a row do no harm; one that never ends is a named error after every attempt is used."""
    client, server = api.serve(source, [fault, fault])
    body = client.get_json(PATH)
    assert isinstance(body, dict)
    assert [item["id"] for item in body["objekter"]] == [901, 902, 903]
    assert len(server.requests) == 3

    client, server = api.serve(source, lambda _: fault, attempts=3)
    with pytest.raises(kind) as caught:
        client.get_json(PATH)
    assert len(server.requests) == caught.value.attempts == 3
    text = str(caught.value)
    assert "127.0.0.1" in text
    assert "(tried 3 times)." in text
    assert "\n" not in text


@pytest.mark.parametrize("status", [400, 401, 403, 404, 410, 501])
def test_client_does_not_repeat_a_request_that_was_refused(api: Any, source: Any, status: int) -> None:
    """A status that time does not heal is final at once."""
    client, server = api.serve(source, lambda _: Fault("status", status=status))
    with pytest.raises(HttpStatusError) as caught:
        client.get_json(PATH)
    assert caught.value.status == status
    assert len(server.requests) == 1
    assert api.waits == []


@pytest.mark.parametrize(
    ("body", "title", "detail"),
    [
        (b'{"type":"about:blank","title":"Bad Request","status":400,"detail":"Ukjent kommune"}',
         "Bad Request", "Ukjent kommune"),
        (b'{"status":400,"error":"Bad Request","message":"no","path":"/y"}', "Bad Request", "no"),
        ("X-Client må være satt.".encode(), "", "X-Client må være satt"),
        (b"<html><body>nginx</body></html>", "", ""),
        (b"\xff\xfe\x00\x01", "", ""),
        (b"[1, 2]", "", ""),
        (b'{"title": 7, "detail": null}', "", ""),
        (b"", "", ""),
    ],
)  # fmt: skip
def test_client_reads_the_words_of_an_error_whatever_its_form(
    api: Any, source: Any, body: bytes, title: str, detail: str
) -> None:
    """ProblemDetail, Spring's document and plain text give their words; HTML and binary give none."""
    client, _ = api.serve(source, lambda _: Fault("status", status=400, body=body))
    with pytest.raises(HttpStatusError) as caught:
        client.get_json(PATH)
    assert (caught.value.title, caught.value.detail) == (title, detail)
    assert "\n" not in str(caught.value)
    assert all(word in str(caught.value) for word in (title, detail, "400", "vegobjekter/96"))


def test_client_is_told_by_the_server_that_x_client_is_missing(api: Any, source: Any) -> None:
    """The replay server refuses a request without X-Client as V4 does: 400 in plain text."""
    _, server = api.serve(source)
    with requests.Session() as session:
        session.trust_env = False
        answer = session.get(server.url + PATH, timeout=5)
    assert answer.status_code == 400
    assert answer.headers["Content-Type"].startswith("text/plain")
    assert answer.content.decode() == "X-Client må være satt når du kaller API Les V4."


@pytest.mark.parametrize(
    ("header", "least", "most"),
    [
        ("7", 7.0, 7.0),
        ("0", 0.5, 1.0),
        ("86400", RETRY_AFTER_CAP_S, RETRY_AFTER_CAP_S),
        ("999999999999", RETRY_AFTER_CAP_S, RETRY_AFTER_CAP_S),
        ("soon", 0.5, 1.0),
        ("-5", 0.5, 1.0),
        ("Fri, 31 Dec 1999 23:59:59 GMT", 0.5, 1.0),
    ],
)
def test_client_waits_as_the_server_asks_but_never_longer_than_the_cap(
    api: Any, source: Any, header: str, least: float, most: float
) -> None:
    """Retry-After sets the wait; past, unreadable and absurd values fall back to back-off or the cap."""
    client, _ = api.serve(source, [Fault("status", status=429, headers={"Retry-After": header})])
    client.get_json(PATH)
    assert len(api.waits) == 1
    assert least <= api.waits[0] <= most


def test_retry_after_as_a_date_is_the_time_until_then() -> None:
    """An HTTP date is counted from now, with or without a time zone, and is 0 when it has passed."""
    now = datetime(2026, 6, 10, 8, 0, tzinfo=UTC)
    later = now + timedelta(seconds=90)
    assert answers.retry_after_s(format_datetime(later, usegmt=True), now) == 90.0
    assert answers.retry_after_s("Wed, 10 Jun 2026 08:01:30 -0000", now) == 90.0
    assert answers.retry_after_s(format_datetime(now - timedelta(days=1), usegmt=True), now) == 0.0


@steady
@given(st.text(max_size=60))
def test_retry_after_is_never_negative_and_never_fails(text: str) -> None:
    """Whatever a server writes there, the result is None or a number from 0 up."""
    seconds = answers.retry_after_s(text)
    assert seconds is None or seconds >= 0.0


def test_client_backs_off_longer_with_every_attempt(api: Any, source: Any) -> None:
    """Waits double, plus at most half a second drawn at random."""
    client, _ = api.serve(source, [Fault("disconnect")] * 4)
    client.get_json(PATH)
    assert len(api.waits) == 4
    for wait, base in zip(api.waits, (0.5, 1.0, 2.0, 4.0), strict=True):
        assert base <= wait <= base + 0.5


def test_client_ends_a_slow_drip_at_its_deadline(api: Any, source: Any) -> None:
    """A body that trickles in is given up at the deadline though no single read ever times out."""
    client, server = api.serve(source, [Fault("drip", pause_s=0.05)], deadline_s=0.3)
    with pytest.raises(DeadlineExceededError, match=r"0\.3 s"):
        client.get_json(PATH)
    assert len(server.requests) == 1


def test_client_does_not_wait_beyond_its_deadline(api: Any, source: Any) -> None:
    """When the wait asked for would pass the deadline, the last error is raised instead."""
    client, server = api.serve(
        source, lambda _: Fault("status", status=503, headers={"Retry-After": "50"}), deadline_s=20.0
    )
    with pytest.raises(HttpStatusError):
        client.get_json(PATH)
    assert len(server.requests) == 1
    assert api.waits == []


def test_client_names_a_server_that_is_not_there(api: Any) -> None:
    """A refused connection is ConnectionFailedError after all attempts."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound and not listening: connections are refused
        client = api.client(f"http://127.0.0.1:{taken.getsockname()[1]}", attempts=2)
        with pytest.raises(ConnectionFailedError, match="cannot be reached") as caught:
            client.get_json(PATH)
    assert caught.value.attempts == 2


def test_client_names_a_server_that_stays_silent(api: Any) -> None:
    """A server that accepts and never answers is ConnectionFailedError after the timeout."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        client = api.client(f"http://127.0.0.1:{silent.getsockname()[1]}", attempts=1, timeout_s=0.2)
        with pytest.raises(ConnectionFailedError, match="silent"):
            client.get_json(PATH)


def test_client_names_a_server_without_tls(api: Any, source: Any) -> None:
    """Asking with https a server that speaks plain http is ConnectionFailedError, not a foreign exception."""
    _, server = api.serve(source)
    client = api.client(server.url.replace("http:", "https:"), attempts=1)
    with pytest.raises(ConnectionFailedError, match="TLS"):
        client.get_json(PATH)


@pytest.mark.parametrize(
    "body", [b'{"a": NaN}', b'{"a": [Infinity]}', b'{"a": -1e999}', b"7", b"true", b"\xe6{}"]
)
def test_client_accepts_only_strict_json(api: Any, source: Any, body: bytes) -> None:
    """NaN, Infinity, numbers beyond float64, bare values and other encodings are refused."""
    client, _ = api.serve(source, lambda _: Fault("status", status=200, body=body), attempts=1)
    with pytest.raises(NotJsonError):
        client.get_json(PATH)


def test_client_refuses_json_nested_beyond_reason(api: Any, source: Any) -> None:
    """A hundred thousand brackets are an error of ours, not a crash of the parser."""
    client, _ = api.serve(
        source, lambda _: Fault("status", status=200, body=b"[" * 100_000 + b"]" * 100_000), attempts=1
    )
    with pytest.raises(NotJsonError):
        client.get_json(PATH)


def test_client_refuses_a_body_larger_than_any_page(
    api: Any, source: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Above the size limit the answer is given up, and not asked for again."""
    monkeypatch.setattr("nvdb.client.client.MAX_BODY_BYTES", 1000)
    client, server = api.serve(source)
    with pytest.raises(BodyError, match="smaller page"):
        client.get_json(PATH, {"inkluder": "alle"})
    assert len(server.requests) == 1


def test_client_reads_a_byte_order_mark_and_an_empty_status_204(api: Any, source: Any) -> None:
    """A BOM is skipped; an empty body, whatever 2xx it comes with, is not taken for data."""
    client, _ = api.serve(source, [Fault("status", status=200, body=b'\xef\xbb\xbf{"a": 1}')])
    assert client.get_json(PATH) == {"a": 1}
    client, _ = api.serve(source, lambda _: Fault("status", status=200, body=b" "), attempts=1)
    with pytest.raises(TruncatedBodyError, match="empty"):
        client.get_json(PATH)
    client, _ = api.serve(source, lambda _: Fault("status", status=304))
    with pytest.raises(HttpStatusError) as caught:
        client.get_json(PATH)
    assert caught.value.status == 304


@pytest.mark.parametrize(
    "options",
    [{"client_name": " "}, {"client_name": "a\r\nX: y"}, {"contact": "å"}, {"attempts": 0}, {"timeout_s": 0}],
)
def test_client_refuses_options_that_cannot_be(options: dict[str, Any]) -> None:
    """Headers that would break the request, and limits of nothing, are refused when the client is made."""
    with pytest.raises(RequestError):
        NvdbClient(**options)


def test_client_pauses_when_its_budget_is_nearly_used_up(api: Any, source: Any) -> None:
    """After an answer that leaves one request the next one waits a moment; 200 left cause no wait."""
    low = Fault("status", status=200, body=b"{}", headers={"x-ratelimit-remaining": "1"})
    client, _ = api.serve(source, [None, low])
    client.get_json(PATH)
    assert client.rate_limit_remaining == 200
    client.get_json(PATH)
    assert (client.rate_limit_remaining, api.waits) == (1, [])
    client.get_json(PATH)
    assert api.waits == [LOW_BUDGET_PAUSE_S]


def test_client_uses_the_session_it_is_given(api: Any, source: Any) -> None:
    """An injected session carries the requests and is still open after the client is closed."""
    _, server = api.serve(source)
    with requests.Session() as session:
        session.trust_env = False
        session.headers["X-From-Session"] = "yes"
        with NvdbClient(server.url, session=session) as client:
            client.get_json(PATH)
        with NvdbClient(server.url, session=session) as client:
            client.get_json(PATH)
    assert [request.headers.get("X-From-Session") for request in server.requests] == ["yes", "yes"]


def test_errors_form_one_tree() -> None:
    """Every error is an NvdbError, and what is refused before sending is a ValueError too."""
    assert issubclass(TransportError, NvdbError)
    assert issubclass(RequestError, NvdbError)
    assert issubclass(RequestError, ValueError)


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=4),
    max_leaves=20,
)


@steady
@given(st.lists(json_values, max_size=4) | st.dictionaries(st.text(), json_values, max_size=4))
def test_json_that_was_written_is_read_back(document: Any) -> None:
    """Reading is the inverse of writing for every finite JSON document."""
    assert answers.json_from_body(json.dumps(document).encode(), "x", "") == document


@steady
@given(st.data())
def test_json_cut_anywhere_is_never_taken_for_whole(data: st.DataObject) -> None:
    """A page cut at any byte raises BodyError: no prefix of it is a page."""
    body = json.dumps(
        {"objekter": [{"id": 1, "navn": "æøå"}], "metadata": {"x": 1}}, ensure_ascii=False
    ).encode()
    end = data.draw(st.integers(0, len(body) - 1))
    with pytest.raises(BodyError):
        answers.json_from_body(body[:end], "x", "")
