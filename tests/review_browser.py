"""A page's server in a thread of the test, and browsers without a screen."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import requests

from twin.review import ReviewOptions, review_app
from twin.store.store import Store
from twin.web import Address, listening
from twin.web.serve import server_of

_PATIENCE_S = 30


@dataclass
class Browser:
    """One browser that has opened the page."""

    url: str
    http: requests.Session = field(default_factory=requests.Session)
    _keys: Iterator[int] = field(default_factory=itertools.count)

    def open(self, token: str) -> requests.Response:
        """Open the page's address."""
        return self.http.get(
            f"{self.url}/", params={"token": token}, allow_redirects=False, timeout=_PATIENCE_S
        )

    def get(self, path: str, **query: Any) -> Any:
        """Ask for something that is there."""
        answer = self.http.get(f"{self.url}/api/{path}", params=query, timeout=_PATIENCE_S)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def post(self, path: str, body: object, key: str | None = None) -> Any:
        """Send something, and return status and body."""
        headers = {"Origin": self.url, "Idempotency-Key": key or f"{id(self)}-{next(self._keys)}"}
        answer = self.http.post(f"{self.url}/api/{path}", json=body, headers=headers, timeout=_PATIENCE_S)
        return answer.status_code, answer.json()

    def answer(self, change_id: str, answer: str, comment: str = "", **more: Any) -> Any:
        """Answer what this browser sees now."""
        seen = self.get(f"finding/{change_id}")["revision"]
        asked = {"change_id": change_id, "answer": answer, "comment": comment, "seen_revision": seen}
        return self.post("answer", {**asked, **more})

    def undo(self) -> Any:
        """Take the last answer back."""
        return self.post("undo", {})

    def state(self, change_id: str) -> str:
        """Return a finding's state as this browser is shown it."""
        state: str = self.get(f"finding/{change_id}")["state"]
        return state


@contextmanager
def served(store: Store, **options: Any) -> Iterator[tuple[Address, str]]:
    """Serve the review page on loopback for the length of the block: where, and by which token."""
    listener, address = listening()
    app, token = review_app(store, ReviewOptions(**options), address)
    server = server_of(app)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    try:
        yield address, token
    finally:
        server.should_exit = True
        thread.join()
        listener.close()


def browser_of(address: Address, token: str, name: str = "") -> Browser:
    """Open the page, and say who one is."""
    one = Browser(f"http://{address.host}:{address.port}")
    assert one.open(token).status_code == 303
    if name:
        assert one.post("reviewer", {"name": name}) == (200, {"reviewer": name})
    return one


Open = Callable[..., Browser]
"""Opens browsers on one server, by the reviewer's name."""
