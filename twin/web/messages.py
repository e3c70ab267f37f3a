"""What goes over the wire: typed records as JSON, and every error as one sentence."""

from __future__ import annotations

from http import HTTPStatus
from typing import TYPE_CHECKING, TypeVar

import msgspec
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from twin.errors import ConfigError, RefusedError, StoreError, TwinError

if TYPE_CHECKING:
    from starlette.exceptions import HTTPException
    from starlette.requests import Request

T = TypeVar("T", bound=msgspec.Struct)

_STATUS: tuple[tuple[type[TwinError], HTTPStatus], ...] = (
    (ConfigError, HTTPStatus.BAD_REQUEST),
    (RefusedError, HTTPStatus.CONFLICT),
    (StoreError, HTTPStatus.SERVICE_UNAVAILABLE),
    (TwinError, HTTPStatus.CONFLICT),
)
_encode = msgspec.json.Encoder().encode


class PageError(Exception):
    """What a page asked for and does not get.

    Parameters
    ----------
    status : HTTPStatus
    sentence : str
        For people.
    """

    def __init__(self, status: HTTPStatus, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status
        self.sentence = sentence


class ErrorMessage(msgspec.Struct, frozen=True):
    """The body of every answer that is none."""

    error: str


def answer_of(record: msgspec.Struct, status: int = HTTPStatus.OK) -> Response:
    """Send a record as JSON."""
    return Response(_encode(record), status, media_type="application/json")


def refusal(status: int, sentence: str) -> Response:
    """Send a sentence that says why not."""
    return answer_of(ErrorMessage(sentence), status)


async def body_of(request: Request, kind: type[T]) -> T:
    """Read a request's body, which the guard keeps small, as a record.

    Raises
    ------
    PageError
        It is not JSON of that kind (400), is too long (413), or is not sent as JSON (415), which the form of
        another page cannot.
    """
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise PageError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "Send JSON, with the type application/json.")
    try:
        return msgspec.json.decode(await request.body(), type=kind)
    except ClientDisconnect as error:
        # The guard ends what is too long in this way; whoever has really gone hears nothing.
        raise PageError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "The request is too large.") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise PageError(HTTPStatus.BAD_REQUEST, f"The request cannot be read: {error}.") from error


def on_page_error(_request: Request, error: Exception) -> Response:
    """Answer a :class:`PageError`."""
    assert isinstance(error, PageError)  # noqa: S101 - registered for nothing else
    return refusal(error.status, error.sentence)


def on_twin_error(_request: Request, error: Exception) -> Response:
    """Answer what twin itself refuses, in its own sentence."""
    status = next(status for kind, status in _STATUS if isinstance(error, kind))
    return refusal(status, str(error))


def on_fault(_request: Request, _error: Exception) -> Response:
    """Answer after an error in twin itself, which stands on the terminal."""
    sentence = "twin made an error, and nothing was changed: the terminal in which it runs says more."
    return refusal(HTTPStatus.INTERNAL_SERVER_ERROR, sentence)


def on_http_exception(_request: Request, error: Exception) -> Response:
    """Answer a wrong address or method."""
    refused: HTTPException = error  # type: ignore[assignment]
    sentences = {
        HTTPStatus.NOT_FOUND: "There is nothing at this address.",
        HTTPStatus.METHOD_NOT_ALLOWED: "This address is not asked in this way.",
    }
    known = sentences.get(HTTPStatus(refused.status_code), refused.detail)
    return refusal(refused.status_code, known)
