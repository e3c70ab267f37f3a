"""Log in to API Skriv by OpenID Connect, as programs do that are no browser.

Source: API Skriv, *Autentisering*: ``/rest/v1/oidc/authenticate`` and ``/refresh``.
"""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Callable
from typing import Any, Final, Literal
from urllib.parse import urlsplit

from nvdb.client import answers
from nvdb.client.client import LOOPBACK, NvdbClient
from nvdb.errors import LoginError, RequestError

Realm = Literal["EMPLOYEE", "SERVICE_ACCOUNT", "EXTERNAL"]

_JSON: Final = {"Accept": "application/json", "Content-Type": "application/json; charset=utf-8"}
RENEW_BEFORE_S: Final = 60.0
"""An id token is renewed this long before it ends."""


class OidcLogin:
    """Gives a valid id token each time it is called: logs in once, then renews (a token lasts some 15 min).

    Parameters
    ----------
    http : NvdbClient
        Client of API Skriv.
    credentials : callable
        Returns user name and password; asked only when a login is needed, and not kept.
    realm : {"EMPLOYEE", "SERVICE_ACCOUNT", "EXTERNAL"}
    clock : callable
        Seconds since 1970.
    """

    def __init__(
        self,
        http: NvdbClient,
        credentials: Callable[[], tuple[str, str]],
        *,
        realm: Realm = "EMPLOYEE",
        clock: Callable[[], float] = time.time,
    ) -> None:
        need_encryption(http)
        self._http = http
        self._credentials = credentials
        self._realm = realm
        self._clock = clock
        self._tokens: dict[str, str] = {}

    def __repr__(self) -> str:
        return f"OidcLogin({self._http.api_url!r}, realm={self._realm!r})"

    def __call__(self) -> str:
        """Return an id token.

        Raises
        ------
        LoginError
            User name or password are not right.
        """
        token = self._tokens.get("idToken", "")
        if not token or _ends_s(token) - RENEW_BEFORE_S < self._clock():
            self._tokens = self._renewed() or self._logged_in()
        return self._tokens["idToken"]

    def _renewed(self) -> dict[str, str]:
        """Tokens by the refresh token; empty where that has ended too."""
        refresh = self._tokens.get("refreshToken")
        if not refresh:
            return {}
        return self._ask("refresh", {"refreshToken": refresh, "realm": self._realm})

    def _logged_in(self) -> dict[str, str]:
        username, password = self._credentials()
        question = {"username": username, "password": password, "realm": self._realm}
        tokens = self._ask("authenticate", question)
        if not tokens:
            where = answers.place(self._http.api_url)
            msg = (
                f"{where} does not take this user name and password: check both, and the realm {self._realm}."
            )
            raise LoginError(msg, status=200)
        return tokens

    def _ask(self, operation: str, question: dict[str, str]) -> dict[str, str]:
        path = f"/rest/v1/oidc/{operation}"
        where = answers.place(f"{self._http.api_url}{path}")
        reply = self._http.request(
            "POST", path, headers=_JSON, body=json.dumps(question).encode(), again=True
        )
        if not 200 <= reply.status < 300:
            msg = f"{where} answered {reply.status}: check the API URL and the user."
            raise LoginError(msg, status=reply.status)
        document = answers.json_from_body(reply.body, where, reply.headers.get("Content-Type", ""))
        # A failed login is an empty object with status 200.
        if not isinstance(document, dict) or not isinstance(document.get("idToken"), str):
            return {}
        return {name: text for name, text in document.items() if isinstance(text, str)}


def need_encryption(http: NvdbClient) -> None:
    """Raise RequestError where a password or token would go over an open line to another machine."""
    parts = urlsplit(http.api_url)
    if parts.scheme != "https" and parts.hostname not in LOOPBACK:
        msg = f"{answers.place(http.api_url)} is asked without encryption: a login goes over https only."
        raise RequestError(msg)


def _ends_s(token: str) -> float:
    """When a JSON Web Token ends, seconds since 1970 (claim ``exp``, RFC 7519); 0 if it does not say."""
    try:
        payload = token.split(".")[1]
        claims: Any = json.loads(base64.urlsafe_b64decode(payload + "=" * (-len(payload) % 4)))
        return float(claims["exp"])
    except (IndexError, ValueError, KeyError, TypeError):
        return 0.0
