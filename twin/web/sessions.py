"""Who has shown the token: one session a browser, known by its cookie until the server ends."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from starlette.requests import Request

_SECRET_BYTES = 24


@dataclass(slots=True)
class Session:
    """One browser.

    Attributes
    ----------
    id : str
        That may be kept with what this browser does: it does not open the door.
    person : str
        Who sits at it; "" until that is known.
    """

    id: str
    person: str = ""


class Sessions:
    """The token of this run of the server, and the browsers that have shown it.

    Parameters
    ----------
    person : str
        Who sits at a browser that has not said otherwise; "" where it is to be asked.
    """

    def __init__(self, person: str = "") -> None:
        self.token = secrets.token_urlsafe(_SECRET_BYTES)
        self._person = person
        self._by_cookie: dict[str, Session] = {}

    def is_token(self, text: str) -> bool:
        """Whether it is the token; how long the answer takes does not tell how much of it is right."""
        return hmac.compare_digest(text.encode("utf-8", "replace"), self.token.encode())

    def begin(self) -> str:
        """Begin a session and return its cookie."""
        cookie = secrets.token_urlsafe(_SECRET_BYTES)
        public = hashlib.sha256(cookie.encode()).hexdigest()[:16]
        self._by_cookie[cookie] = Session(public, self._person)
        return cookie

    def get(self, cookie: str | None) -> Session | None:
        """Return the session of a cookie, if it is one of this run."""
        return None if cookie is None else self._by_cookie.get(cookie)


def session_of(request: Request) -> Session:
    """Return the session of a request that the guard let through."""
    session: Session = request.scope["state"]["session"]
    return session
