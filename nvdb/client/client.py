"""One GET against API Les V4 that returns validated JSON, or raises a named error; and one bare request.

API Les V4 demands ``X-Client``. The retry has to lie outside the HTTP library, because a truncated body is
found only when the body is read and parsed (psf/requests #4956, #6512), and ``timeout`` there bounds one
socket read and not the whole answer. Redirects are followed here too: the HTTP library would take the headers
that name the user to whatever host an answer points at.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, NamedTuple, TypeVar
from urllib.parse import SplitResult, unquote_plus, urlsplit

import requests
import tenacity
import urllib3

from nvdb.client import answers
from nvdb.client.redirects import hide_location, redirect_target, shown
from nvdb.errors import (
    BodyError,
    ConnectionFailedError,
    DeadlineExceededError,
    HttpStatusError,
    RedirectError,
    RequestError,
    TransportError,
    TruncatedBodyError,
)

log = logging.getLogger(__name__)

API_URL = "https://nvdbapiles.atlas.vegvesen.no"
"""API Les V4, current since May 2025. The test environment is ``nvdbapiles.test.atlas.vegvesen.no``."""

Json = dict[str, Any] | list[Any]
T = TypeVar("T")
Params = Mapping[str, str | int]


class Reply(NamedTuple):
    """What came back, whatever its status."""

    status: int
    headers: Mapping[str, str]
    body: bytes


MAX_BODY_BYTES = 256 * 2**20
"""A full page of 1000 objects is below 20 MB; more than this is not a page."""
MAX_REDIRECTS = 5
"""Redirects followed for one request, all of them on the API's own host."""
RETRY_AFTER_CAP_S = 60.0
"""Longest wait that a ``Retry-After`` can ask for."""
LOW_BUDGET = 1
"""At this many requests left (``x-ratelimit-remaining``) the client pauses before the next."""
LOW_BUDGET_PAUSE_S = 1.0

_CONTACT = re.compile(r"[^@\s]+@[^@\s.]+(\.[^@\s.]+)+|https?://[^\s/]+\S*")
_CHUNK_BYTES = 2**16
LOOPBACK = {"localhost", "127.0.0.1", "::1"}
_REDIRECTS = {301, 302, 303, 307, 308}


class NvdbClient:
    """A polite client for API Les V4. One client a thread.

    Parameters
    ----------
    api_url : str
        Base URL, http or https.
    client_name : str
        Sent as ``X-Client``, which V4 demands.
    contact : str, optional
        E-mail or web address, sent as ``X-Kontaktperson``, so that the road authority can reach whoever
        runs this.
    timeout_s : float
        Longest silence: for the connection, and between two bytes of an answer.
    deadline_s : float
        Longest time for one request, attempts and waits included. The body is read in small pieces and the
        clock looked at after each, so that a slow drip ends too; the overshoot is at most `timeout_s`. (A
        drip inside the status line or a header is bounded by `timeout_s` a byte only.)
    attempts : int
        How often a request is sent at most.
    session : requests.Session, optional
        Transport; own adapters, proxies or certificates go in here. It is not closed by the client.
    sleep : callable
        Waits that many seconds; tests pass their own.
    """

    def __init__(
        self,
        api_url: str = API_URL,
        *,
        client_name: str = "nvdb-twin",
        contact: str | None = None,
        timeout_s: float = 30.0,
        deadline_s: float = 300.0,
        attempts: int = 5,
        session: requests.Session | None = None,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._base = _checked_base(api_url)
        self.api_url = api_url.rstrip("/")
        self.client_name = client_name
        self._headers = _checked_headers(client_name, contact)
        if not (timeout_s > 0 and deadline_s > 0 and attempts >= 1):
            msg = "NvdbClient needs timeout_s and deadline_s above 0 and at least one attempt."
            raise RequestError(msg)
        self._timeout_s = timeout_s
        self._deadline_s = deadline_s
        self._attempts = attempts
        self._sleep = sleep
        self._owns_session = session is None
        self._session = session or _new_session(self._base)
        self.rate_limit_remaining: int | None = None
        """``x-ratelimit-remaining`` of the last answer; None until the server has said it."""

    def __enter__(self) -> NvdbClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections, unless the session came from outside."""
        if self._owns_session:
            self._session.close()

    def get_json(self, path_or_url: str, params: Params | None = None) -> Json:
        """GET one document and return it parsed.

        Sent again, after an exponential wait or what ``Retry-After`` asks (at most 60 s), on 408, 425, 429
        and 5xx, on lost connections, and on bodies that are cut short or not JSON. Other statuses are final.
        Redirects are followed on the API's own scheme and host, and from http to https on that host; nothing
        is sent to another one.

        Parameters
        ----------
        path_or_url : str
            A path below ``api_url`` (``/vegobjekter/96``) or a URL on the same host.
        params : mapping, optional
            Query parameters.

        Returns
        -------
        dict or list
            Strict JSON: NaN, Infinity and numbers too large for a float64 are refused.

        Raises
        ------
        TransportError
            One of its kinds, see :mod:`nvdb.errors`; ``attempts`` says how often it was tried.
        RequestError
            The URL is not http(s), or not on the API's host.
        """
        url = self._url(path_or_url)
        return self._retrying(self._attempts, lambda deadline: self._get_once(url, params, deadline))

    def request(
        self,
        method: str,
        path_or_url: str,
        *,
        headers: Mapping[str, str],
        body: bytes | None = None,
        params: Params | None = None,
        again: bool = False,
    ) -> Reply:
        """Send one request of any kind and return what comes, also an error status or a redirect.

        Nothing is followed. With `again` (only where a second arrival does no harm) it is sent again as
        :meth:`get_json` does, and a status that may pass raises in the end. `headers` are never logged.

        Raises
        ------
        TransportError
            No whole answer.
        """
        url = self._url(path_or_url)

        def once(deadline: float) -> Reply:
            response, content = self._send(url, params, deadline, method, body, headers)
            if again and not 200 <= response.status_code < 300:
                where = answers.place(url)
                bad = answers.status_error(response.status_code, response.headers, content, where)
                if bad.retryable:
                    raise bad
            return Reply(response.status_code, response.headers, content)

        return self._retrying(self._attempts if again else 1, once)

    def _retrying(self, attempts: int, once: Callable[[float], T]) -> T:
        """Call `once` with the deadline until it succeeds or nothing more may be tried."""
        deadline = time.monotonic() + self._deadline_s
        retrying = tenacity.Retrying(
            sleep=self._sleep,
            stop=tenacity.stop_after_attempt(attempts) | tenacity.stop_before_delay(self._deadline_s),
            wait=_wait_s,
            retry=tenacity.retry_if_exception(
                lambda error: isinstance(error, TransportError) and error.retryable
            ),
            before_sleep=_tell,
            reraise=True,
        )
        try:
            return retrying(once, deadline)
        except TransportError as error:
            error.attempts = retrying.statistics["attempt_number"]
            raise

    def _url(self, path_or_url: str) -> str:
        """Absolute URL; another host is refused, so that nothing an answer says can lead elsewhere."""
        if path_or_url.startswith("/") or "://" not in path_or_url:
            return f"{self.api_url}/{path_or_url.lstrip('/')}"
        parts = urlsplit(path_or_url)
        if (parts.scheme, parts.netloc) != (self._base.scheme, self._base.netloc):
            here = answers.place(self.api_url)
            msg = f"{answers.place(path_or_url)} is not on {here}: ask only the API's own host."
            raise RequestError(msg)
        return path_or_url

    def _get_once(self, url: str, params: Params | None, deadline: float) -> Json:
        """One attempt: GET, follow redirects on the API's own host, read all, check, parse."""
        for _ in range(1 + MAX_REDIRECTS):
            where = answers.place(url)
            response, body = self._send(url, params, deadline)
            location = response.raw.headers.get("Location", "")
            if response.status_code not in _REDIRECTS or not location:
                break
            url, params = redirect_target(url, location), None
        else:
            msg = f"{where} redirects in a circle, to {shown(url)}: check the API URL and the proxy."
            raise RedirectError(msg)
        if not 200 <= response.status_code < 300:
            raise answers.status_error(response.status_code, response.headers, body, where)
        return answers.json_from_body(body, where, response.headers.get("Content-Type", ""))

    def _send(
        self,
        url: str,
        params: Params | None,
        deadline: float,
        method: str = "GET",
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> tuple[requests.Response, bytes]:
        """Send one request and read what comes, a redirect included."""
        where = answers.place(url)
        if self.rate_limit_remaining is not None and self.rate_limit_remaining <= LOW_BUDGET:
            self.rate_limit_remaining = None
            self._sleep(LOW_BUDGET_PAUSE_S)
        timeout_s = max(min(self._timeout_s, deadline - time.monotonic()), 0.001)
        try:
            request = self._session.prepare_request(
                requests.Request(
                    method,
                    url,
                    params=params,
                    data=body,
                    headers={**self._headers, **(headers or {})},
                    # A bare login keeps a .netrc on this machine from replacing the token.
                    auth=_unchanged if headers else None,
                )
            )
            request.hooks["response"].append(hide_location)
            settings = self._session.merge_environment_settings(request.url, {}, True, None, None)
            began = time.monotonic()
            with self._session.send(
                request, timeout=timeout_s, allow_redirects=False, **settings
            ) as response:
                self._note_budget(response)
                content = self._read(response, where, deadline)
        except (requests.exceptions.InvalidSchema, requests.exceptions.InvalidURL) as error:
            msg = f"{where} is not an address that can be asked: check the API URL and the proxy."
            raise RequestError(msg) from error
        except (requests.RequestException, urllib3.exceptions.HTTPError, OSError) as error:
            raise _named(error, where) from error
        _tell_request(request, where, response.status_code, len(content), time.monotonic() - began)
        return response, content

    def _read(self, response: requests.Response, where: str, deadline: float) -> bytes:
        """Read the body as it comes. ``read1`` returns after one socket read, so a drip cannot hide here."""
        body = bytearray()
        while chunk := response.raw.read1(_CHUNK_BYTES, decode_content=True):
            body += chunk
            if len(body) > MAX_BODY_BYTES:
                msg = f"{where} sent more than {MAX_BODY_BYTES >> 20} MB: ask for a smaller page."
                raise BodyError(msg)
            if time.monotonic() > deadline:
                msg = (
                    f"{where} was still sending after {self._deadline_s:g} s: try again later, ask for "
                    "smaller pages, or allow a longer deadline."
                )
                raise DeadlineExceededError(msg)
        return bytes(body)

    def _note_budget(self, response: requests.Response) -> None:
        text = response.headers.get("x-ratelimit-remaining", "")
        self.rate_limit_remaining = int(text) if re.fullmatch(r"[0-9]{1,9}", text) else None


def _unchanged(request: requests.PreparedRequest) -> requests.PreparedRequest:
    return request


def _tell_request(
    request: requests.PreparedRequest, where: str, status: int, n_bytes: int, seconds: float
) -> None:
    """Say what was asked and how long it took; of questions to API Les alone also with what parameters."""
    query = urlsplit(request.url or "").query if "Authorization" not in request.headers else ""
    if request.method != "GET":
        query = ""
    asked = f"{where}?{unquote_plus(query)}" if query else where
    log.debug("%s %s: %d, %s bytes in %.2f s", request.method, asked, status, f"{n_bytes:,}", seconds)


def _tell(state: tenacity.RetryCallState) -> None:
    """Say that an attempt failed and that another follows: a wait without a word looks like a hang."""
    if state.outcome is not None and state.next_action is not None:
        log.info("%s Trying again in %.0f s.", state.outcome.exception(), state.next_action.sleep)


def _wait_s(state: tenacity.RetryCallState) -> float:
    """Seconds before the next attempt: what the server asks, capped, and never less than our own back-off."""
    error = state.outcome.exception() if state.outcome is not None else None
    asked_s = error.retry_after_s if isinstance(error, HttpStatusError) else None
    return max(_back_off(state), min(asked_s or 0.0, RETRY_AFTER_CAP_S))


_back_off = tenacity.wait_exponential(multiplier=0.5, max=30.0) + tenacity.wait_random(0.0, 0.5)


_NAMES: tuple[tuple[tuple[type[Exception], ...], type[TransportError], str], ...] = (
    (
        (requests.exceptions.ContentDecodingError, urllib3.exceptions.DecodeError),
        TruncatedBodyError,
        "sent a body whose compression is damaged: try again later",
    ),
    (
        (requests.exceptions.SSLError, urllib3.exceptions.SSLError),
        ConnectionFailedError,
        "cannot be trusted (TLS): check the certificates and the clock of this machine",
    ),
    (
        (requests.Timeout, urllib3.exceptions.TimeoutError, TimeoutError),
        ConnectionFailedError,
        "was silent for too long: check the network, or try again later",
    ),
    (
        (requests.exceptions.ChunkedEncodingError, urllib3.exceptions.ProtocolError),
        TruncatedBodyError,
        "broke off in the middle of its answer: try again later",
    ),
)
"""Errors of the HTTP library → our name and what to say after host and path. The first that fits is taken."""


def _named(error: Exception, where: str) -> TransportError:
    for kinds, name, clause in _NAMES:
        if isinstance(error, kinds):
            return name(f"{where} {clause}.")
    return ConnectionFailedError(f"{where} cannot be reached or hangs up: check the network and the API URL.")


def _checked_base(api_url: str) -> SplitResult:
    try:
        parts = urlsplit(api_url)
        # A name or password in the URL would end up in the store as the mirror's source.
        usable = parts.scheme in {"http", "https"} and bool(parts.hostname) and parts.username is None
        _ = parts.port  # raises ValueError if it is not a number
    except ValueError:
        usable = False
    if not usable:
        # A password in it is not to end up on the screen or in a log.
        shown_url = re.sub(r"(?<=//)[^/]*@", "…@", api_url)
        msg = f"The API URL {shown_url!r} is not an http(s) address: give one such as {API_URL}."
        raise RequestError(msg)
    return parts


def _checked_headers(client_name: str, contact: str | None) -> dict[str, str]:
    headers = {"Accept": "application/json", "X-Client": client_name}
    if contact:
        headers["X-Kontaktperson"] = contact
    for name, value in headers.items():
        if not value.strip() or not value.isprintable() or not value.isascii():
            msg = f"The header {name} is {value!r}: API Les V4 wants printable ASCII text."
            raise RequestError(msg)
    if contact and not _CONTACT.fullmatch(contact):
        msg = (
            f"The contact {contact!r} is neither an e-mail address nor a web address: give one at which the "
            "road authority can reach you, such as kari@kommune.no."
        )
        raise RequestError(msg)
    return headers


def _new_session(base: SplitResult) -> requests.Session:
    session = requests.Session()
    # A replay server on this machine must not be asked for through the company's proxy.
    session.trust_env = base.hostname not in LOOPBACK
    return session
