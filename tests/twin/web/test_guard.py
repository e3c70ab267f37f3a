"""What a stranger's page, a guessed name or a forged request gets from the server: 403, and no more."""

from __future__ import annotations

import http.client
import json
from collections.abc import Iterator

import pytest
import sqlalchemy as sa
from review_browser import Browser, browser_of, served

from twin.errors import ConfigError, RefusedError
from twin.store import schema
from twin.store.store import Store
from twin.web import Address, listening
from twin.web.guard import MAX_BODY_BYTES, Outside


@pytest.fixture
def page(opened: Store) -> Iterator[Browser]:
    """Kari's browser on a page that runs."""
    with served(opened) as (address, token):
        yield browser_of(address, token, "kari")


def raw(
    page: Browser, method: str, path: str, headers: dict[str, str], body: bytes = b""
) -> tuple[int, bytes]:
    """Send a request as no library would: with its own Host, and a path that nobody tidies up."""
    connection = http.client.HTTPConnection(page.url.removeprefix("http://"), timeout=30)
    connection.putrequest(method, path, skip_host="Host" in headers, skip_accept_encoding=True)
    cookie = "; ".join(f"{c.name}={c.value}" for c in page.http.cookies)
    for name, value in {"Cookie": cookie, **headers}.items():
        connection.putheader(name, value)
    connection.endheaders(body)
    answer = connection.getresponse()
    found = answer.status, answer.read()
    connection.close()
    return found


ANSWER = json.dumps({"change_id": "89cb19927fd6", "answer": "accept", "seen_revision": ""}).encode()
JSON = {"Content-Type": "application/json", "Content-Length": str(len(ANSWER))}


def test_own_page_is_let_in_by_the_token_alone(opened: Store) -> None:
    """Its cookie is the server's own, for HTTP and this site only; the token leaves the address."""
    with served(opened) as (address, token):
        browser = Browser(f"http://127.0.0.1:{address.port}")
        assert browser.http.get(f"{browser.url}/", timeout=30).status_code == 403
        assert browser.open(f"{token}x").status_code == browser.open("").status_code == 403
        answer = browser.open(token)
        assert (answer.status_code, answer.headers["Location"]) == (303, "/")
        cookie = answer.headers["Set-Cookie"]
        assert cookie.startswith(f"twin_review_{address.port}=")
        assert {"HttpOnly", "SameSite=strict", "Path=/"} <= set(cookie.split("; "))
        assert token not in cookie
        assert "Set-Cookie" not in browser.open(token).headers


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "localhost", "127.0.0.1:1", "127.0.0.1.evil.example", ""]
)
def test_name_that_is_not_the_servers_is_refused(page: Browser, host: str) -> None:
    """DNS rebinding leads a stranger's name here, with the browser's cookies for that name."""
    assert raw(page, "GET", "/api/session", {"Host": host})[0] == 403


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"Origin": "null"},
        {"Origin": "https://evil.example"},
        {"Origin": "http://127.0.0.1:1"},
        {"Origin": "{own}", "Sec-Fetch-Site": "cross-site"},
    ],
)
def test_forged_answer_is_refused(page: Browser, opened: Store, headers: dict[str, str]) -> None:
    """Without this page's Origin nothing is changed, whatever cookie the browser adds."""
    told = {name: value.format(own=page.url) for name, value in headers.items()}
    assert raw(page, "POST", "/api/answer", {**JSON, **told}, ANSWER)[0] == 403
    assert opened.count(schema.decision_log) == 0


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_other_pages_of_this_browser_read_nothing(page: Browser, site: str) -> None:
    """Also those of another port of this machine, whose cookie it is too; a link to the page works."""
    assert raw(page, "GET", "/api/session", {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "no-cors"})[0] == 403
    visit = {"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "navigate"}
    assert raw(page, "GET", "/", visit)[0] != 403
    assert raw(page, "GET", "/api/session", {"Origin": "https://evil.example"})[0] == 403


def test_no_answer_opens_itself_to_other_origins(page: Browser) -> None:
    """No CORS header, not even for a preflight; every answer has the policy that keeps the page at home."""
    preflight = {"Origin": "https://evil.example", "Access-Control-Request-Method": "POST"}
    for answer in (
        page.http.options(f"{page.url}/api/answer", headers=preflight, timeout=30),
        page.http.get(f"{page.url}/api/session", timeout=30),
        page.http.get(f"{page.url}/nowhere", timeout=30),
    ):
        assert not [name for name in answer.headers if name.lower().startswith("access-control")]
        assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
        assert "http" not in answer.headers["Content-Security-Policy"]
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert answer.headers["Referrer-Policy"] == "no-referrer"
        assert "uvicorn" not in answer.headers.get("Server", "")


def test_base_map_opens_its_own_host_only_for_pictures() -> None:
    """No script, style or frame comes from it."""
    policy = Outside(("https://cache.kartverket.no",)).policy().split("; ")
    assert [rule.split()[0] for rule in policy if "kartverket" in rule] == ["img-src", "connect-src"]


@pytest.mark.parametrize(
    "path",
    [
        "/static/../app.py", "/static/..%2fapp.py", "/static/%2e%2e/app.py", "/static/..%5capp.py",
        "/static//etc/passwd", "/static/%2fetc%2fpasswd", "/static/vendor/../../app.py",
        "/crop/../../twin.db", "/crop/..%2f..%2ftwin.db.webp", "/sign/../../app.py",
    ],
)  # fmt: skip
def test_no_path_leads_out_of_the_pages_files(page: Browser, path: str) -> None:
    """Whatever is made of dots, slashes and their codes."""
    status, body = raw(page, "GET", path, {})
    assert status in (400, 404)
    assert b"import" not in body
    assert b"root:" not in body


def test_large_body_is_refused_unread(page: Browser) -> None:
    """By its length, and by what comes where none is said."""
    headers = {"Origin": page.url, "Content-Type": "application/json"}
    big = b" " * (MAX_BODY_BYTES + 1)
    assert raw(page, "POST", "/api/answer", {**headers, "Content-Length": str(len(big))})[0] == 413
    chunked = b"%x\r\n%b\r\n0\r\n\r\n" % (len(big), big)
    status, _ = raw(page, "POST", "/api/answer", {**headers, "Transfer-Encoding": "chunked"}, chunked)
    assert status == 413


def test_form_of_another_page_cannot_answer(page: Browser) -> None:
    """A form sends text or fields, never JSON."""
    headers = {"Origin": page.url, "Content-Type": "text/plain", "Content-Length": str(len(ANSWER))}
    assert raw(page, "POST", "/api/answer", headers, ANSWER)[0] == 415


def test_errors_are_sentences(page: Browser) -> None:
    """Also for an address or a method that there is not."""
    for method, path, status in (
        ("GET", "/nowhere", 404),
        ("POST", "/api/session", 405),
        ("GET", "/api/finding/x", 404),
    ):
        headers = {"Origin": page.url, "Content-Length": "0"}
        found, body = raw(page, method, path, headers)
        assert found == status
        assert json.loads(body)["error"].endswith(".")


def test_session_of_the_log_does_not_open_the_door(page: Browser, opened: Store) -> None:
    """What is kept with an answer is made from the cookie, and the cookie cannot be made from it."""
    page.answer("89cb19927fd6", "accept")
    (kept,) = opened.rows(sa.select(schema.decision_log.c.session))
    (cookie,) = page.http.cookies
    assert kept["session"]
    assert kept["session"] not in (cookie.value or "")
    assert raw(page, "GET", "/api/session", {"Cookie": f"{cookie.name}={kept['session']}"})[0] == 403


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "", "no.such.host.invalid", "192.0.2.7"])
def test_no_network_is_listened_to_by_accident(host: str) -> None:
    """Every address at once is refused, and so is a name that is none."""
    with pytest.raises(ConfigError, match=r"no address of this machine|every network"):
        listening(host)


def test_port_that_is_taken_is_told() -> None:
    """With the cure."""
    taken, address = listening()
    with taken, pytest.raises(RefusedError, match="name another, or 0"):
        listening(port=address.port)


def test_address_beyond_loopback_answers_only_to_itself() -> None:
    """Another machine writes it; the name localhost is none of it."""
    assert Address("192.168.1.20", 80).hosts == {"192.168.1.20:80"}
    assert not Address("192.168.1.20", 80).is_loopback
    assert Address("127.0.0.1", 80).origins == {"http://127.0.0.1:80", "http://localhost:80"}


def test_modules_are_served_as_scripts(page: Browser) -> None:
    """A browser runs no module that is called plain text."""
    answer = page.http.get(f"{page.url}/static/app.js", timeout=30)
    assert answer.status_code == 200
    assert answer.headers["Content-Type"] == "text/javascript; charset=utf-8"
