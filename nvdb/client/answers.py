"""What an answer of the API says: strict JSON from a body, a named error from a bad status.

V4 answers errors with ProblemDetail (RFC 9457); its gateway with plain text, Spring's error document or HTML.
So a body is read by what it is, and its declared content type only helps to word the message.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Any
from urllib.parse import urlsplit

import msgspec

from nvdb.errors import HttpStatusError, NotJsonError, RateLimitedError, TruncatedBodyError

_MAX_DETAIL_CHARS = 200
_CURES = {
    400: "check the parameters and that X-Client is set",
    401: "this object type needs a login, leave it out",
    403: "this object type or client is not allowed, leave it out or ask the road authority",
    404: "check the API URL, the object type and the id",
    410: "this address has been shut down, update the API URL",
    429: "wait a minute and try again",
}


class JsonObject(dict[str, Any]):
    """A member of a page's list of objects: a dict that also knows the very text it was read from.

    Attributes
    ----------
    text : bytes
        As sent (UTF-8), so that an object can be kept to the last character, and without writing it anew.
    """

    __slots__ = ("text",)
    text: bytes


class _Page(msgspec.Struct, forbid_unknown_fields=True):
    """All that a page of objects has."""

    objekter: list[msgspec.Raw] | msgspec.UnsetType = msgspec.UNSET
    vegobjekter: list[msgspec.Raw] | msgspec.UnsetType = msgspec.UNSET
    metadata: Any = msgspec.UNSET


_PAGE_DECODER = msgspec.json.Decoder(_Page)
_VALUE_DECODER = msgspec.json.Decoder()


def place(url: str) -> str:
    """Host and path of a URL, without query and without credentials: what a message may show."""
    parts = urlsplit(url)
    host = parts.netloc.rpartition("@")[2]
    return f"{host}{parts.path}"


def json_from_body(body: bytes, where: str, content_type: str) -> dict[str, Any] | list[Any]:
    """Parse a whole body as strict JSON. The objects of a page are :class:`JsonObject`.

    Raises
    ------
    TruncatedBodyError
        It begins as JSON and ends in the middle.
    NotJsonError
        It is something else, is not UTF-8, or holds NaN, Infinity or a number beyond float64.
    """
    if not body.strip():
        msg = f"{where} answered with an empty body: try again later."
        raise TruncatedBodyError(msg)
    try:
        document = _page_of_objects(body)
        if document is None:
            document = _DECODER.decode(body.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise _unparsable(body, where, content_type, error) from error
    if not isinstance(document, dict | list):
        msg = f"{where} answered with a bare JSON value instead of a document: check the API URL."
        raise NotJsonError(msg)
    return document


def _page_of_objects(body: bytes) -> dict[str, Any] | None:
    """Parse a page of objects; None for every other body, also one with a fault or a lone surrogate.

    msgspec is as strict as `_DECODER` and three times as fast, but takes no lone surrogate and says less
    about a fault.
    """
    document: dict[str, Any] = {}
    try:
        page = _PAGE_DECODER.decode(body)
        for name in ("objekter", "vegobjekter"):
            items = getattr(page, name)
            if items is not msgspec.UNSET:
                document[name] = [_json_object(bytes(item)) for item in items]
    except (ValueError, TypeError, RecursionError):
        return None  # the plain way meets the same fault, and says where in the text it is
    if page.metadata is not msgspec.UNSET:
        document["metadata"] = page.metadata
    return document


def _json_object(text: bytes) -> Any:
    value = _VALUE_DECODER.decode(text)
    if type(value) is not dict:
        return value
    made = JsonObject(value)
    made.text = text
    return made


def _unparsable(
    body: bytes, where: str, content_type: str, error: Exception
) -> TruncatedBodyError | NotJsonError:
    start, end = body.strip()[:1], body.strip()[-1:]
    closing = {b"{": b"}", b"[": b"]"}.get(start)
    if closing is not None and end != closing:
        return TruncatedBodyError(f"{where} sent JSON that ends in the middle: try again later.")
    if isinstance(error, UnicodeDecodeError):
        return NotJsonError(f"{where} sent text that is not UTF-8: check the proxy.")
    if closing is not None:
        return NotJsonError(
            f"{where} sent JSON that is not valid ({error}): report it to the road authority."
        )
    kind = "an HTML page" if b"<html" in body[:2000].lower() or "html" in content_type else "something"
    return NotJsonError(f"{where} sent {kind} that is not JSON: check the API URL and the proxy.")


def _refuse_constant(name: str) -> float:
    msg = f"{name} is not a JSON number"
    raise ValueError(msg)


def _finite_float(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        msg = f"{text[:20]} is beyond float64"
        raise ValueError(msg)
    return value


_DECODER = json.JSONDecoder(parse_constant=_refuse_constant, parse_float=_finite_float)


def status_error(status: int, headers: Mapping[str, str], body: bytes, where: str) -> HttpStatusError:
    """Make the error for a bad status from whatever the body is."""
    title, detail = _title_and_detail(body)
    said = " – ".join(part for part in (title, detail) if part)
    cure = _CURES.get(status, "try again later" if status >= 500 else "check the API URL and the parameters")
    message = f"{where} answered {status}{f' ({said})' if said else ''}: {cure}."
    kind = RateLimitedError if status == 429 else HttpStatusError
    return kind(
        message,
        status=status,
        title=title,
        detail=detail,
        retry_after_s=retry_after_s(headers.get("Retry-After", "")),
    )


def _title_and_detail(body: bytes) -> tuple[str, str]:
    """Read ProblemDetail's or Spring's words; else the text itself, unless it is HTML or binary."""
    text = body.decode("utf-8", errors="replace").strip()
    try:
        document = json.loads(text)
    except (ValueError, RecursionError):
        readable = not text.startswith("<") and "\ufffd" not in text and "\x00" not in text
        return "", _one_line(text) if readable else ""
    if not isinstance(document, dict):
        return "", ""
    title = document.get("title") or document.get("error")
    detail = document.get("detail") or document.get("message")
    return _one_line(title), _one_line(detail)


def _one_line(value: object) -> str:
    text = re.sub(r"\s+", " ", value).strip().rstrip(".") if isinstance(value, str) else ""
    return text if len(text) <= _MAX_DETAIL_CHARS else text[: _MAX_DETAIL_CHARS - 1] + "…"


def retry_after_s(text: str, now: datetime | None = None) -> float | None:
    """Seconds that a ``Retry-After`` header asks for (RFC 9110, section 10.2.3): a number or an HTTP date.

    Returns None for an empty or unreadable header, and 0 for a date that has passed.
    """
    text = text.strip()
    if re.fullmatch(r"[0-9]{1,12}(\.[0-9]+)?", text):
        return float(text)
    try:
        moment = parsedate_to_datetime(text)
    except (ValueError, TypeError, OverflowError):
        return None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return max(0.0, (moment - (now or datetime.now(UTC))).total_seconds())
