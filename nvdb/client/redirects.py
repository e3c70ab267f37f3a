"""Where a redirect may lead: the API's own host, and nowhere else."""

from __future__ import annotations

from typing import Final
from urllib.parse import SplitResult, quote, urljoin, urlsplit, urlunsplit

import requests

from nvdb.client import answers
from nvdb.errors import RedirectError

_URL_SAFE: Final = "!#$%&'()*+,/:;=?@[]~"
_DEFAULT_PORTS: Final = {"http": 80, "https": 443}


def hide_location(response: requests.Response, **_: object) -> None:
    """Keep requests from preparing the next request of a redirect.

    It does so even when told not to follow: it then reads the whole body, beyond our deadline and size limit,
    and a damaged address ends in a bare ValueError. What the server said stays in ``response.raw.headers``.
    """
    response.headers.pop("Location", None)


def redirect_target(url: str, location: str) -> str:
    """Where a redirect of `url` leads; RedirectError unless that is the same API.

    The result is put together from `url`'s own host and only the path and query of `location`, so that no
    two ways to read an odd address can lead to another host.
    """
    where = answers.place(url)
    # The HTTP library reads headers as latin-1, though what is sent is UTF-8 or, rightly, percent-encoded.
    location = quote(location.encode("latin-1", "replace"), safe=_URL_SAFE)
    old = urlsplit(url)
    try:
        new = urlsplit(urljoin(url, location))
        scheme, netloc = _same_api(old, new)
    except ValueError as error:
        msg = f"{where} redirects to {location[:200]}, which is no address: check the API URL and the proxy."
        raise RedirectError(msg) from error
    if new.scheme not in _DEFAULT_PORTS:
        msg = f"{where} redirects to {shown(new.geturl())}, which is not http(s): check the API URL."
        raise RedirectError(msg)
    if not netloc:
        msg = (
            f"{where} redirects to {shown(new.geturl())}, which is not the API's own host, and nothing was "
            "sent there: check the API URL and the proxy."
        )
        raise RedirectError(msg)
    return urlunsplit((scheme, netloc, new.path, new.query, ""))


def _same_api(old: SplitResult, new: SplitResult) -> tuple[str, str]:
    """Scheme and host to ask after a redirect from `old` to `new`; both empty if that is another API."""
    ports = tuple(parts.port or _DEFAULT_PORTS.get(parts.scheme) for parts in (old, new))
    if new.hostname == old.hostname and new.username is None:
        if new.scheme == old.scheme and ports[0] == ports[1]:
            return old.scheme, old.netloc
        if (old.scheme, new.scheme) == ("http", "https") and ports == (80, 443):
            return "https", old.netloc.removesuffix(":80")
    return "", ""


def shown(url: str) -> str:
    """Scheme, host and path: what a message may show of an address that an answer gave."""
    return f"{urlsplit(url).scheme}://{answers.place(url)}"[:200]
