"""What can go wrong between here and the road database.

::

    NvdbError
    ├── TransportError               the API could not be asked, or did not answer properly
    │   ├── ConnectionFailedError    name lookup, refused, reset, TLS, or silence for too long
    │   ├── DeadlineExceededError    the total time for one request is used up
    │   ├── RedirectError            redirects that go round in a circle, or leave the API's own host
    │   ├── HttpStatusError          a status other than 2xx, with ProblemDetail's title and detail
    │   │   ├── RateLimitedError     429, also after waiting as the server asked
    │   │   └── LoginError           API Skriv does not take the login, or the user may not do this
    │   └── BodyError                a body that is damaged or larger than any real page
    │       ├── TruncatedBodyError   a body that ends too early
    │       └── NotJsonError         status 200 with something other than JSON (often a gateway's HTML)
    ├── SchemaError                  JSON, but not what API Les V4 documents
    │   └── PagingError              a cursor that goes in a circle, a page that comes again
    ├── RequestError                 a question that is refused before it is sent (also a ``ValueError``)
    │   ├── AreaError                an area that cannot be: bad kommune, bad box
    │   └── EndringssettError        a change set in which our own checks found errors
    └── ReplaySourceError            recorded pages that cannot be replayed

Every message is one sentence: what, where (host and path), and the cure.
"""

from __future__ import annotations


class NvdbError(Exception):
    """Base of every error that ``nvdb`` raises."""


class TransportError(NvdbError):
    """The API could not be asked, or did not answer properly.

    Attributes
    ----------
    attempts : int
        How often the request was sent before this was raised.
    retryable : bool
        Whether the same request may succeed a little later.
    """

    retryable = False

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.attempts = 1

    def __str__(self) -> str:
        message = super().__str__()
        if self.attempts == 1:
            return message
        return f"{message.removesuffix('.')} (tried {self.attempts} times)."


class ConnectionFailedError(TransportError):
    """No connection: name lookup, refused, reset, TLS, or no byte within the timeout."""

    retryable = True


class DeadlineExceededError(TransportError):
    """The total time for one request, all attempts included, is used up."""


class RedirectError(TransportError):
    """Redirects that go round in a circle, or to something other than the API's own host."""


class HttpStatusError(TransportError):
    """A status other than 2xx.

    Attributes
    ----------
    status : int
        HTTP status code.
    title, detail : str
        From ProblemDetail (RFC 9457) or Spring's error document; of plain text, the text is the detail. May
        be empty.
    retry_after_s : float or None
        What the server asked for, in seconds from the answer; None if it asked for nothing readable.
    """

    def __init__(
        self,
        message: str,
        *,
        status: int,
        title: str = "",
        detail: str = "",
        retry_after_s: float | None = None,
    ) -> None:
        super().__init__(message)
        self.status = status
        self.title = title
        self.detail = detail
        self.retry_after_s = retry_after_s
        # 501 and 505 say that the server never will; every other 5xx may pass.
        self.retryable = status in {408, 425, 429} or (status >= 500 and status not in {501, 505})


class RateLimitedError(HttpStatusError):
    """429: too many requests, also after waiting as the server asked."""


class LoginError(HttpStatusError):
    """API Skriv does not take the login (302, 401), or the user may not do this (403)."""


class BodyError(TransportError):
    """A body that cannot be decoded, or that is larger than any real page."""


class TruncatedBodyError(BodyError):
    """A body that ends before its declared length, or in the middle of its JSON."""

    retryable = True


class NotJsonError(BodyError):
    """A body that is not JSON although the status says that all is well."""

    retryable = True


class SchemaError(NvdbError):
    """JSON that is not what API Les V4 documents; the message names the object and the field."""


class PagingError(SchemaError):
    """A cursor that goes in a circle or a page that comes again: stopping silently would lose signs."""


class RequestError(NvdbError, ValueError):
    """A question that is refused before it is sent."""


class AreaError(RequestError):
    """An area that cannot be asked for."""


class EndringssettError(RequestError):
    """A change set that is not sent, because our own checks found errors in it.

    Attributes
    ----------
    findings : tuple of str
        One sentence each.
    """

    def __init__(self, message: str, findings: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.findings = findings


class ReplaySourceError(NvdbError):
    """Recorded pages or generated objects that cannot be replayed."""
