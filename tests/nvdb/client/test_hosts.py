"""Whom the client asks: its own host alone, wherever a redirect leads and whatever an address says."""

from __future__ import annotations

from typing import Any

import pytest
import requests

from nvdb.client import API_URL, NvdbClient
from nvdb.client.client import MAX_REDIRECTS
from nvdb.errors import BodyError, HttpStatusError, RedirectError, RequestError
from nvdb.replay import Fault, ReplayServer

PATH = "/vegobjekter/96"


def _redirect(location: str, **fault: Any) -> Fault:
    return Fault("status", status=302, headers={"Location": location}, **fault)


def test_client_names_a_redirect_loop(api: Any, source: Any) -> None:
    """A redirect that goes round in a circle is an error of its own and is not tried again."""
    client, server = api.serve(source, [Fault("redirect_loop")])
    with pytest.raises(RedirectError, match=r"circle, to http://127\.0\.0\.1:[0-9]+/replay/redirect-loop"):
        client.get_json(PATH)
    assert len(server.requests) == 1 + MAX_REDIRECTS
    assert api.waits == []


@pytest.mark.parametrize("n", [1, MAX_REDIRECTS])
def test_client_follows_redirects_on_its_own_host(api: Any, source: Any, n: int) -> None:
    """Up to MAX_REDIRECTS, absolute or relative, lead to the answer, with the target's query."""
    client, server = api.serve(
        source, [_redirect(f"{PATH}?antall=2")] * (n - 1) + [_redirect("96?antall=1#top")]
    )
    assert [item["id"] for item in client.get_json(PATH, {"antall": 3})["objekter"]] == [901]
    assert [request.query["antall"] for request in server.requests] == ["3", *["2"] * (n - 1), "1"]
    assert all(request.headers["X-Client"] for request in server.requests)

    client, server = api.serve(source, lambda seen: None if seen.number else _redirect(f"{server.url}{PATH}"))
    assert client.get_json(PATH)["objekter"]


@pytest.mark.parametrize("host", ["http://127.0.0.1:{port}", "http://localhost:{port}", "//127.0.0.1:{port}"])
@pytest.mark.parametrize("status", [301, 302, 303, 307, 308])
def test_client_sends_nothing_to_another_host(api: Any, source: Any, host: str, status: int) -> None:
    """A redirect to another server is an error that names it, and that server sees no request."""
    _, other = api.serve(source)
    target = host.format(port=other.url.rpartition(":")[2])
    fault = Fault("status", status=status, headers={"Location": f"{target}{PATH}?secret=1"})
    client, server = api.serve(source, lambda _: fault, contact="a@b.no")
    with pytest.raises(RedirectError, match="not the API's own host") as caught:
        client.get_json(PATH)
    assert f"{target.removeprefix('http:').lstrip('/')}{PATH}" in str(caught.value)
    assert "secret" not in str(caught.value)
    assert other.requests == []
    assert len(server.requests) == 1
    assert api.waits == []


def test_client_sends_nothing_to_another_host_after_a_redirect_of_its_own(api: Any, source: Any) -> None:
    """The way out is barred on every step and not only on the first."""
    _, other = api.serve(source)
    client, server = api.serve(source, [_redirect("/first"), _redirect(other.url + PATH)])
    with pytest.raises(RedirectError, match="/first redirects to"):
        client.get_json(PATH)
    assert (len(server.requests), other.requests) == (2, [])


@pytest.mark.parametrize(
    "location",
    [
        "https://{host}/x",  # another port than the one that speaks http, unless both are the standard ones
        "http://a:b@{host}/x",
        "http://{host}@elsewhere.invalid/x",
        "http://elsewhere.invalid\\@{host}/x",
        "http://{host}.elsewhere.invalid/x",
        "http://{host}\\.elsewhere.invalid/x",
        "\\\\elsewhere.invalid/x",
        "http://[elsewhere/x",
        "http://127.0.0.1:99999/x",
        "file:///etc/hostname",
        "ftp://{host}/x",
        "javascript:alert(1)",
    ],
)
def test_client_is_not_led_astray_by_an_odd_address(api: Any, source: Any, location: str) -> None:
    """Other schemes, credentials and damaged addresses are refused, or read as a path on the own host."""
    client, _ = api.serve(source, lambda info: _redirect(location.format(host=info.headers["Host"])))
    with pytest.raises(RedirectError) as caught:
        client.get_json(PATH)
    assert "\n" not in str(caught.value)
    assert "a:b" not in str(caught.value)
    assert "redirects" in str(caught.value)


def test_client_follows_no_redirect_out_of_http(api: Any, source: Any) -> None:
    """A redirect to a file is refused."""
    client, _ = api.serve(source, [_redirect("file:///etc/hostname")])
    with pytest.raises(RedirectError, match="file:///etc/hostname, which is not http"):
        client.get_json(PATH)


class _Carrier(requests.adapters.HTTPAdapter):
    """Brings requests for any host to a server on loopback, and notes where they were meant to go."""

    def __init__(self, server: ReplayServer) -> None:
        super().__init__()
        self.server = server
        self.sent: list[str] = []

    def send(self, request: requests.PreparedRequest, *args: Any, **options: Any) -> requests.Response:
        assert request.url is not None
        self.sent.append(request.url)
        carried = request.copy()
        carried.url = self.server.url + request.path_url
        return super().send(carried, *args, **options)


@pytest.mark.parametrize(
    ("api_url", "location", "followed"),
    [
        ("http://nvdb.test", f"https://nvdb.test{PATH}", True),
        ("http://nvdb.test:80", f"https://NVDB.test:443{PATH}", True),
        ("https://nvdb.test", f"https://nvdb.test:443{PATH}", True),
        ("https://nvdb.test", f"http://nvdb.test{PATH}", False),
        ("http://nvdb.test", f"https://nvdb.test:8443{PATH}", False),
        ("http://nvdb.test", f"http://nvdb.test:8080{PATH}", False),
        ("http://nvdb.test", f"https://www.nvdb.test{PATH}", False),
    ],
)
def test_client_follows_from_http_to_https_and_never_back(
    api: Any, source: Any, api_url: str, location: str, followed: bool
) -> None:
    """The same host over https, on the standard ports, is the same API; nothing else is."""
    _, server = api.serve(source, [_redirect(location)])
    with requests.Session() as session:
        session.trust_env = False
        carrier = _Carrier(server)
        session.mount("http://", carrier)
        session.mount("https://", carrier)
        client = api.client(api_url, session=session)
        if followed:
            assert client.get_json(PATH)["objekter"]
        else:
            with pytest.raises(RedirectError, match="not the API's own host"):
                client.get_json(PATH)
    assert carrier.sent == [api_url + PATH, f"https://nvdb.test{PATH}"][: 1 + followed]


def test_client_bounds_the_body_of_a_redirect(api: Any, source: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """What comes with a redirect is read under the same limits as any answer."""
    monkeypatch.setattr("nvdb.client.client.MAX_BODY_BYTES", 1000)
    client, _ = api.serve(source, [_redirect("/elsewhere", body=b"x" * 5000)])
    with pytest.raises(BodyError, match="smaller page"):
        client.get_json(PATH)


def test_client_takes_a_redirect_to_nowhere_for_a_bad_status(api: Any, source: Any) -> None:
    """A 302 without a Location is the status that it is."""
    client, _ = api.serve(source, lambda _: Fault("status", status=302))
    with pytest.raises(HttpStatusError, match="answered 302"):
        client.get_json(PATH)


def test_client_keeps_the_hooks_of_its_session(api: Any, source: Any) -> None:
    """Response hooks of an injected session see every answer, redirects included."""
    _, server = api.serve(source, [_redirect(PATH)])
    seen: list[int] = []
    with requests.Session() as session:
        session.trust_env = False
        session.hooks["response"].append(lambda response, **_: seen.append(response.status_code))
        api.client(server.url, session=session).get_json(PATH)
        assert len(session.hooks["response"]) == 1
    assert seen == [302, 200]


def test_client_asks_only_its_own_host(api: Any, source: Any) -> None:
    """An absolute URL elsewhere, and any scheme but http(s), is refused before anything is sent."""
    client, server = api.serve(source)
    assert client.get_json(server.url + PATH, {"antall": 1}) == client.get_json(PATH, {"antall": 1})
    for url in ("http://127.0.0.1:1/vegobjekter/96", API_URL + PATH, "file:///etc/hostname"):
        with pytest.raises(RequestError, match="only the API's own host"):
            client.get_json(url)
    assert len(server.requests) == 2


@pytest.mark.parametrize(
    "url",
    ["", "nvdbapiles.atlas.vegvesen.no", "ftp://x", "http://", "http://x:y", "http://a:b@x", "file:///x"],
)
def test_client_refuses_an_api_url_that_cannot_be(url: str) -> None:
    """Anything but http(s) with a host and without credentials is refused when the client is made."""
    with pytest.raises(RequestError, match="not an http"):
        NvdbClient(url)


@pytest.mark.parametrize("host", [".nvdb.test", "*.nvdb.test", "nvdb test"])
def test_client_names_an_api_url_that_no_host_can_have(api: Any, host: str) -> None:
    """A host name that cannot be asked for is a RequestError, not a redirect."""
    with pytest.raises(RequestError, match="check the API URL"):
        api.client(f"http://{host}").get_json(PATH)
