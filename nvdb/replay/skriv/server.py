"""A local server that speaks the change-set protocol of API Skriv V3, with its refusals.

For tests, and for trying out what a change set would meet, without an account:

>>> with SkrivReplayServer(SkrivWorld(), users={"olanor": "hemmelig"}) as server:    # doctest: +SKIP
...     http = NvdbClient(server.url)
...     client = SkrivClient(http, OidcLogin(http, lambda: ("olanor", "hemmelig")))

It speaks XML. What it knows of NVDB is a :class:`nvdb.replay.skriv.world.SkrivWorld`.
"""

from __future__ import annotations

import base64
import json
import logging
import re
import secrets
import threading
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Final
from urllib.parse import parse_qsl, urlsplit

from nvdb.endringssett import Endringssett, ValidationFinding, errors, from_xml, to_xml, validate
from nvdb.errors import ReplaySourceError, SchemaError
from nvdb.replay.loopback import Answer, Loopback, LoopbackHandler, LoopbackServer
from nvdb.replay.skriv.answers import fault_xml, fremdrift_xml, list_xml, ressurser_xml, status_xml
from nvdb.replay.skriv.world import NO_RIGHT, SkrivWorld
from nvdb.skriv.status import AVVIST, FINAL, IKKE_STARTET, KANSELLERT, UTFORT

log = logging.getLogger(__name__)

TOKEN_S: Final = 900
_SETS: Final = re.compile(r"(?:/nvdb/apiskriv)?/rest/v3/endringssett(?:/([^/]+)(?:/(\w+))?)?")
_LOGIN: Final = re.compile(r"(?:/nvdb/apiskriv)?/rest/v1/oidc/(authenticate|refresh)")


@dataclass(slots=True)
class _Set:
    """A registered set and what is to be said about it, one code a question."""

    sett: Endringssett
    dry_run: bool
    received: datetime
    owner: str
    client: str
    codes: list[str] = field(default_factory=lambda: [IKKE_STARTET])
    findings: tuple[ValidationFinding, ...] = ()
    made: Mapping[int, tuple[int, int]] = field(default_factory=dict)
    done: datetime | None = None


XML: Final = "application/xml; charset=UTF-8"
JSON: Final = "application/json; charset=utf-8"


class _RefusedError(Exception):
    """A request that is not taken."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


class SkrivReplayServer(Loopback):
    """Serve API Skriv on loopback until the ``with`` block ends.

    Parameters
    ----------
    world : SkrivWorld
    users : mapping of user name → password
    roles : bool
        Whether the users have the role that the endpoints demand; without it every answer is 403.
    on_the_way : sequence of str
        Codes that are shown between the start and the final one, one a question.
    port : int
        0 takes a free one.

    Attributes
    ----------
    requests : list of (method, path)
        In order of arrival.
    lose : list of str
        Ends of method and path (``POST /rest/v3/endringssett``, ``/start``) whose next answer is lost
        after the request was carried out.
    """

    def __init__(
        self,
        world: SkrivWorld,
        *,
        users: Mapping[str, str],
        roles: bool = True,
        on_the_way: Sequence[str] = ("BEHANDLES",),
        port: int = 0,
    ) -> None:
        self.world = world
        self.users = dict(users)
        self.roles = roles
        self.on_the_way = tuple(on_the_way)
        self.port = port
        self.requests: list[tuple[str, str]] = []
        self.lose: list[str] = []
        self._sets: dict[str, _Set] = {}
        self._tokens: dict[str, tuple[float, str]] = {}
        self._refresh: dict[str, str] = {}
        self._lock = threading.Lock()

    def _make_server(self) -> LoopbackServer:
        try:
            return _Server((self._host, self.port), self)
        except (OSError, OverflowError) as error:
            msg = f"Port {self.port} cannot be used ({error}): take another, or 0 for a free one."
            raise ReplaySourceError(msg) from error

    def end_tokens(self) -> None:
        """Let every id token end now."""
        self._tokens.clear()

    def answer(
        self, method: str, path: str, headers: Mapping[str, str], body: bytes, query: str = ""
    ) -> Answer:
        """Answer one request."""
        with self._lock:
            self.requests.append((method, path))
            try:
                login = _LOGIN.fullmatch(path)
                if login is not None:
                    return self._login(login.group(1), body)
                set_id, action = self._allowed(path, headers)
                if set_id is None and method == "GET":
                    return self._search(self._owner(headers), dict(parse_qsl(query)))
                if set_id is None or set_id == "validator":
                    return self._new(method, set_id, headers, body)
                return self._known(method, set_id, action)
            except _RefusedError as refusal:
                return Answer(refusal.status, fault_xml(str(refusal)), XML)

    def _allowed(self, path: str, headers: Mapping[str, str]) -> tuple[str | None, str | None]:
        """Id and action of a path, for those who may ask."""
        match = _SETS.fullmatch(path)
        if match is None:
            raise _RefusedError(404, "Ressursen ble ikke funnet")
        bearer = _bearer(headers)
        if self._tokens.get(bearer, (0.0, ""))[0] < self.world.now().timestamp():
            raise _RefusedError(401, "Mangler eller ugyldig autentiseringstoken")
        if not self.roles:
            raise _RefusedError(403, "Brukeren mangler rolle for endepunktet")
        if not headers.get("X-Client"):
            raise _RefusedError(400, "X-Client mangler")
        return match.group(1), match.group(2)

    def _login(self, operation: str, body: bytes) -> Answer:
        try:
            question = json.loads(body)
        except ValueError as error:
            raise _RefusedError(400, "Ugyldig JSON") from error
        name = self._refresh.get(question.get("refreshToken", ""))
        if operation == "authenticate":
            name = question.get("username")
            name = name if name in self.users and self.users[name] == question.get("password") else None
        if name is None:
            return Answer(200, b"{ }", JSON)
        ends = self.world.now().timestamp() + TOKEN_S
        claims = base64.urlsafe_b64encode(json.dumps({"exp": ends}).encode()).decode().rstrip("=")
        token = f"e30.{claims}.{secrets.token_hex(8)}"
        refresh = f"refresh-{secrets.token_hex(8)}"
        self._tokens[token], self._refresh[refresh] = (ends, name), name
        tokens = {"idToken": token, "accessToken": "unused", "refreshToken": refresh}
        return Answer(200, json.dumps(tokens).encode(), JSON)

    def _new(self, method: str, kind: str | None, headers: Mapping[str, str], body: bytes) -> Answer:
        """Validate a set, or register one."""
        if method != "POST":
            raise _RefusedError(405, "Metoden er ikke tillatt")
        if not headers.get("Content-Type", "").startswith("application/xml"):
            raise _RefusedError(415, "Media-typen støttes ikke")
        try:
            sett = from_xml(body)
        except SchemaError as error:
            raise _RefusedError(400, str(error)) from error
        now = self.world.now()
        if kind == "validator":
            found = validate(sett, self.world.katalog)
            code = AVVIST if errors(found) else UTFORT
            return Answer(200, status_xml(sett, code, found, now, _reason(code, found)), XML)
        if not sett.endringer:
            raise _RefusedError(422, "Endringssettet inneholder ingen vegobjekter")
        set_id = str(uuid.uuid4())
        dry_run = headers.get("X-NVDB-DryRun", "").lower() in {"true", "ja"}
        self._sets[set_id] = _Set(sett, dry_run, now, self._owner(headers), headers["X-Client"])
        relations = ("self", "start", "kanseller", "status", "fremdrift")
        where = {"Location": f"{self.url}/rest/v3/endringssett/{set_id}"}
        return Answer(201, ressurser_xml(self.url, set_id, relations), XML, where)

    def _owner(self, headers: Mapping[str, str]) -> str:
        return self._tokens[_bearer(headers)][1]

    def _search(self, owner: str, query: Mapping[str, str]) -> Answer:
        """List a user's sets, the oldest first."""
        since = int(query.get("fraEpochMs", "0")) / 1000
        client = query.get("brukernavnEllerKlient")
        found = [
            (set_id, entry)
            for set_id, entry in self._sets.items()
            if entry.owner == owner
            and entry.received.timestamp() >= since
            and client in {None, entry.owner, entry.client}
        ]
        start = int(query.get("start", "1")) - 1
        page = found[start : start + min(int(query.get("antall", "1000")), 1000)]
        rows = [(set_id, entry.codes[0], entry.received) for set_id, entry in page]
        return Answer(200, list_xml(rows, len(found)), XML)

    def _known(self, method: str, set_id: str, action: str | None) -> Answer:
        """Start, cancel or tell about a registered set."""
        entry = self._sets.get(set_id)
        if entry is None or action not in {None, "start", "kanseller", "fremdrift", "status"}:
            raise _RefusedError(404, f"Endringssettet {set_id} ble ikke funnet")
        if method != ("POST" if action in {"start", "kanseller"} else "GET"):
            raise _RefusedError(405, "Metoden er ikke tillatt")
        if action is None:
            return Answer(200, to_xml(entry.sett), XML)
        if action == "fremdrift":
            code = entry.codes.pop(0) if len(entry.codes) > 1 else entry.codes[0]
            return Answer(200, fremdrift_xml(code), XML)
        if action == "status":
            return self._status(entry)
        if action == "start":
            if entry.codes != [IKKE_STARTET]:
                raise _RefusedError(422, f"Endringssettet er allerede startet: {entry.codes[0]}")
            self._process(entry)
        else:
            if entry.codes[0] in FINAL:
                raise _RefusedError(422, f"Endringssettet er ferdigbehandlet: {entry.codes[0]}")
            entry.codes = [KANSELLERT]
        return Answer(202, ressurser_xml(self.url, set_id, ("fremdrift", "status", "self")), XML)

    def _status(self, entry: _Set) -> Answer:
        code = entry.codes[0]
        shown = entry.findings if code in FINAL else ()
        made = entry.made if code in FINAL else {}
        reason = _reason(code, shown)
        return Answer(200, status_xml(entry.sett, code, shown, entry.received, reason, made, entry.done), XML)

    def _process(self, entry: _Set) -> None:
        entry.findings = self.world.refusals(entry.sett)
        refused = bool(errors(entry.findings))
        if not refused and not entry.dry_run:
            entry.made = self.world.carry_out(entry.sett)
            entry.done = self.world.now()
        entry.codes = [*self.on_the_way, AVVIST if refused else UTFORT]


def _reason(code: str, findings: Sequence[ValidationFinding]) -> str | None:
    if code != AVVIST:
        return None
    return "IKKE_AUTORISERT" if any(f.code == NO_RIGHT for f in findings) else "VALIDERINGSFEIL"


def _bearer(headers: Mapping[str, str]) -> str:
    return headers.get("Authorization", "").removeprefix("Bearer ")


class _Server(LoopbackServer):
    def __init__(self, address: tuple[str, int], replay: SkrivReplayServer) -> None:
        self.replay = replay
        super().__init__(address, _Handler)


class _Handler(LoopbackHandler):
    """One connection, for one request."""

    server: _Server

    def do_GET(self) -> None:
        """Answer one GET."""
        self._reply("GET")

    def do_POST(self) -> None:
        """Answer one POST."""
        self._reply("POST")

    def _reply(self, method: str) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        parts = urlsplit(self.path)
        path = parts.path
        replay = self.server.replay
        answer = replay.answer(method, path, dict(self.headers.items()), body, parts.query)
        for end in replay.lose:
            if f"{method} {path}".endswith(end):
                replay.lose.remove(end)
                return  # the connection closes without a word
        self.send_answer(answer)
