"""Client of API Skriv V3: validate, send, start, poll, report.

Source: API Skriv V3, *Introduksjon* and *API-referanse*. Everything is asked for and sent as XML, the form
that is documented throughout. What was never tried from here is the live API: its documents date from 2023.
"""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import Final

from nvdb.client import answers
from nvdb.client.client import NvdbClient, Params, Reply
from nvdb.datakatalog.katalog import Datakatalog
from nvdb.endringssett import Endringssett, errors, to_xml
from nvdb.endringssett import validate as validate_here
from nvdb.errors import (
    DeadlineExceededError,
    EndringssettError,
    HttpStatusError,
    LoginError,
    RequestError,
    TransportError,
)
from nvdb.skriv import status as skriv_status
from nvdb.skriv.login import need_encryption
from nvdb.skriv.status import EndringssettStatus, ListedSet, SetContent

log = logging.getLogger(__name__)

SKRIV_URL: Final = "https://nvdbapiskriv.atlas.vegvesen.no"
SKRIV_TEST_URL: Final = "https://nvdbapiskriv.test.atlas.vegvesen.no"
"""Vegvesenet's test environment: a change set goes here first."""

_PATH: Final = "/rest/v3/endringssett"
_XML: Final = "application/xml"
SEARCH_PAGE: Final = 1000
"""Sets on a page of the search; more are not given."""
MIN_POLL_S: Final = 1.0
MAX_POLL_S: Final = 30.0
LOCK_POLL_S: Final = 60.0
"""Wait where the set has been worked on and waits for a lock, or for API Les to catch up."""


class SkrivClient:
    """One user's change sets.

    Parameters
    ----------
    http : NvdbClient
        Client of `SKRIV_TEST_URL` or `SKRIV_URL`; it holds the time limits.
    token : callable
        Returns a valid id token of OpenID Connect, such as a :class:`nvdb.skriv.login.OidcLogin`. It is asked
        before every request, sent as ``Authorization: Bearer`` over https only, and never logged or kept.
    sleep, clock : callable
        Waits, and seconds that only grow; tests pass their own.
    """

    def __init__(
        self,
        http: NvdbClient,
        token: Callable[[], str],
        *,
        sleep: Callable[[float], None] = time.sleep,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        need_encryption(http)
        self._http = http
        self._token = token
        self._sleep = sleep
        self._clock = clock

    def validate(self, sett: Endringssett) -> EndringssettStatus:
        """Have a set checked for form and datakatalog. Nothing is registered, so it is sent again on trouble.

        A set that passes may still be refused when it is compared with what NVDB holds.
        """
        reply = self._call("POST", f"{_PATH}/validator", body=to_xml(sett), again=True)
        return skriv_status.status_from_xml(reply.body)

    def send(self, sett: Endringssett, *, dry_run: bool = False) -> str:
        """Register a set and return its id. NVDB is not changed before it is started.

        Parameters
        ----------
        dry_run : bool
            When started, everything is checked and nothing written (``X-NVDB-DryRun``).

        Raises
        ------
        TransportError
            It is not sent a second time: where the answer was lost, the set may have been registered. That
            does no harm, as it is not started.
        """
        headers = {"X-NVDB-DryRun": "true"} if dry_run else {}
        reply = self._call("POST", _PATH, body=to_xml(sett), headers=headers)
        return skriv_status.set_id_from_ressurser(reply.body)

    def start(self, set_id: str) -> None:
        """Have a registered set processed.

        Where the answer is lost, the progress tells whether it was started; if not, it is started again.
        """
        path = f"{_PATH}/{_checked(set_id)}/start"
        try:
            self._call("POST", path)
        except TransportError as error:
            if isinstance(error, HttpStatusError) and error.status < 500:
                raise
            log.info("%s Asking whether the change set was started.", error)
            if self.progress(set_id) == skriv_status.IKKE_STARTET:
                self._call("POST", path)

    def cancel(self, set_id: str) -> None:
        """Cancel a set that is not finished."""
        self._call("POST", f"{_PATH}/{_checked(set_id)}/kanseller")

    def progress(self, set_id: str) -> str:
        """Ask how far a set is: its code of progress, such as ``BEHANDLES``."""
        reply = self._call("GET", f"{_PATH}/{_checked(set_id)}/fremdrift", again=True)
        return skriv_status.fremdrift_from_xml(reply.body)

    def poll(self, set_id: str, *, timeout_s: float = 3600.0, until_indexed: bool = False) -> str:
        """Ask for the progress until it is final, as seldom as the documentation wants.

        Parameters
        ----------
        timeout_s : float
            Longest time to wait. Sets that wait for a lock can take days: poll again later.
        until_indexed : bool
            Wait until API Les shows the result too.

        Returns
        -------
        str
            The final code.

        Raises
        ------
        DeadlineExceededError
            It is not final after `timeout_s`; it goes on without us.
        RequestError
            It was never started.
        """
        deadline = self._clock() + timeout_s
        wait_s, has_run = MIN_POLL_S, False
        while True:
            code = self.progress(set_id)
            if code in skriv_status.FINAL and not (until_indexed and code == skriv_status.UTFORT):
                return code
            if code == skriv_status.IKKE_STARTET:
                msg = f"Change set {set_id} was never started: start it first."
                raise RequestError(msg)
            has_run |= code == skriv_status.BEHANDLES
            pause_s = wait_s if code == skriv_status.BEHANDLES or not has_run else LOCK_POLL_S
            if self._clock() + pause_s > deadline:
                msg = f"Change set {set_id} is {code} after {timeout_s:g} s: ask for its status later."
                raise DeadlineExceededError(msg)
            self._sleep(pause_s)
            wait_s = min(1.5 * wait_s, MAX_POLL_S)

    def status(self, set_id: str) -> EndringssettStatus:
        """Everything that API Skriv says about a set."""
        reply = self._call("GET", f"{_PATH}/{_checked(set_id)}/status", again=True)
        return skriv_status.status_from_xml(reply.body, set_id=set_id)

    def sets_since(self, since: datetime) -> tuple[ListedSet, ...]:
        """Search the sets that this user registered with a client of this name since then, the oldest first.

        Source: *API-referanse*, *Søke etter endringssett*.
        """
        found: dict[str, ListedSet] = {}
        while True:
            query: dict[str, str | int] = {
                "antall": SEARCH_PAGE,
                "start": len(found) + 1,
                "sorterPå": "TID",
                "sorterStigende": "JA",
                "fraEpochMs": int(since.timestamp() * 1000),
                "brukernavnEllerKlient": self._http.client_name,
            }
            reply = self._call("GET", _PATH, params=query, again=True)
            page = {item.set_id: item for item in skriv_status.listed_sets_from_xml(reply.body)}
            if page.keys() <= found.keys():
                return tuple(found.values())
            found |= page

    def content(self, set_id: str) -> SetContent:
        """Ask what a registered set says of itself."""
        reply = self._call("GET", f"{_PATH}/{_checked(set_id)}", again=True)
        return skriv_status.set_content_from_xml(reply.body)

    def submit(
        self,
        sett: Endringssett,
        *,
        dry_run: bool = False,
        katalog: Datakatalog | None = None,
        timeout_s: float = 3600.0,
    ) -> EndringssettStatus:
        """Do all of it: our own checks, the validator, register, start, poll, and the status.

        Returns
        -------
        EndringssettStatus
            Of the set; or the validator's answer (without `set_id`), where that refused it and nothing was
            registered.

        Raises
        ------
        EndringssettError
            Our own checks found errors: nothing was sent.
        TransportError
            As :meth:`send`, :meth:`start` and :meth:`poll`.
        """
        found = tuple(str(finding) for finding in errors(validate_here(sett, katalog)))
        if found:
            msg = f"The change set has {len(found)} errors and is not sent; the first: {found[0]}"
            raise EndringssettError(msg, found)
        checked = self.validate(sett)
        if not checked.accepted:
            return checked
        set_id = self.send(sett, dry_run=dry_run)
        log.info("Change set %s is registered.", set_id)
        self.start(set_id)
        self.poll(set_id, timeout_s=timeout_s)
        return self.status(set_id)

    def _call(
        self,
        method: str,
        path: str,
        *,
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
        params: Params | None = None,
        again: bool = False,
    ) -> Reply:
        """Send one request with the token; an error by name for every status but 2xx."""
        every = {
            "Accept": _XML,
            "Authorization": f"Bearer {_checked_token(self._token())}",
            "X-Request-ID": str(uuid.uuid4()),
        }
        if body is not None:
            every["Content-Type"] = _XML
        reply = self._http.request(
            method, path, headers={**every, **(headers or {})}, body=body, params=params, again=again
        )
        if not 200 <= reply.status < 300:
            raise _refusal(reply, answers.place(f"{self._http.api_url}{path}"))
        return reply


def _checked(set_id: str) -> str:
    """An id goes into an address: only letters, digits and hyphens."""
    if not set_id or not set_id.isascii() or not set_id.replace("-", "").isalnum():
        msg = f"The id {set_id[:40]!r} is no change set's: give the one that sending it returned."
        raise RequestError(msg)
    return set_id


def _checked_token(token: str) -> str:
    if not token or not token.isascii() or not token.isprintable() or " " in token:
        msg = "The id token is empty or holds characters that no token has: log in again."
        raise RequestError(msg)
    return token


def _refusal(reply: Reply, where: str) -> HttpStatusError:
    """Name a status; 302 is how a missing login shows outside the road authority's network."""
    said = skriv_status.fault_messages(reply.body)
    why = f" ({said})" if said else ""
    if reply.status in {302, 401}:
        msg = f"{where} answered {reply.status}{why}: the id token is missing or too old, log in again."
        return LoginError(msg, status=reply.status, detail=said)
    if reply.status == 403:
        msg = f"{where} answered 403{why}: your user lacks the role for this, ask the road authority for it."
        return LoginError(msg, status=403, detail=said)
    if reply.status in {400, 404, 405, 406, 415, 422}:
        cure = {404: "check the id of the change set", 422: "look at its status"}.get(
            reply.status, "check the API URL and the set with its schema"
        )
        return HttpStatusError(
            f"{where} answered {reply.status}{why}: {cure}.", status=reply.status, detail=said
        )
    return answers.status_error(reply.status, reply.headers, reply.body, where)
