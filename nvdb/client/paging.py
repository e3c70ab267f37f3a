"""The only paging loop.

API Les V4 never says "last page": ``neste`` is always there, and the end is an empty page that repeats the
cursor. A page may be short without being the last (pages are limited by size), and empty without being the
last, as long as its cursor leads on; a query without hits gives an empty page without ``neste``. Uberiket
leaves ``neste`` out on the last page. The cursor is followed, not ``neste.href``: no answer can lead to
another host.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from nvdb.client.client import NvdbClient, Params
from nvdb.errors import PagingError, SchemaError

RawObject = Mapping[str, Any]
T = TypeVar("T")
Item = TypeVar("Item", bound=RawObject)

MAX_EMPTY_PAGES: Final = 2000
"""So many empty pages in a row have no end: NVDB's 1.2 million plates, the most of any type of sign, fill
fewer pages, should all of them be filtered away."""


@dataclass(frozen=True, slots=True)
class Page:
    """One page that holds objects.

    Attributes
    ----------
    objects : tuple of dict
        The vegobjekter as received, at least one.
    cursor : str or None
        ``start`` that this page was asked with; None for the first.
    next_cursor : str or None
        ``start`` of the page that follows, ``<id>:<versjon>``; None if the answer named none.
    """

    objects: tuple[RawObject, ...]
    cursor: str | None
    next_cursor: str | None


def identity(item: RawObject) -> object:
    """Tell an item of a page from every other: an object's id and version, or an event's id and time."""
    metadata = item.get("metadata")
    versjon = metadata.get("versjon") if isinstance(metadata, Mapping) else item.get("versjon")
    return item.get("id"), versjon, item.get("tidspunkt"), item.get("hendelseId")


def follow(
    ask: Callable[[str | None], tuple[T, Sequence[Item], str | None]],
    start: str | None,
    what: str,
    *,
    key: Callable[[Item], object] = identity,
) -> Iterator[tuple[T, str | None]]:
    """Follow cursors to the end.

    Parameters
    ----------
    ask : callable
        Cursor → page, the items on it as received, next cursor (None where the answer names none).
    start : str or None
    what : str
        What is paged through, for messages.
    key : callable
        Item → what no other item has: a page is known again by the keys on it.

    Yields
    ------
    page, next_cursor
        Pages that hold items. The end is a page without a next cursor (Uberiket), or an empty page that does
        not lead on (Les V4).

    Raises
    ------
    PagingError
        A page with items that leads to a cursor that has been used, or that holds exactly the items of an
        earlier page: to stop or to go on silently would lose what should have been there. Or
        `MAX_EMPTY_PAGES` empty pages in a row, each of which leads on.
    """
    cursor, used, n_empty = start, {start}, 0
    contents: set[int] = set()
    while True:
        page, items, following = ask(cursor)
        if not items and (following is None or following in used):
            return
        n_empty = 0 if items else n_empty + 1
        if n_empty >= MAX_EMPTY_PAGES:
            msg = f"{n_empty:,} pages of {what} in a row are empty and lead on: start the sync again later."
            raise PagingError(msg)
        content = hash(tuple(str(key(item)) for item in items))
        if items and (following in used - {None} or content in contents):
            msg = (
                f"The page of {what} after cursor {cursor or 'none'} leads back to where it came from "
                f"(next cursor {following}): start the sync again."
            )
            raise PagingError(msg)
        if items:
            yield page, following
        if following is None:
            return
        contents.add(content)
        used.add(following)
        cursor = following


def iter_pages(
    client: NvdbClient,
    path: str,
    params: Params | None = None,
    start: str | None = None,
    *,
    key: Callable[[RawObject], object] = identity,
) -> Iterator[Page]:
    """Yield the pages of a query of API Les V4 until its end; nothing for a query without hits.

    Parameters
    ----------
    client : NvdbClient
    path : str
        For example ``/vegobjekter/96``.
    params : mapping, optional
        Query parameters other than ``start``.
    start : str, optional
        Cursor to go on from, as saved from an earlier page's ``next_cursor``.
    key : callable
        As in :func:`follow`: needed for whatever has no ``id``.

    Raises
    ------
    PagingError
        As :func:`follow`.
    SchemaError
        A page without ``objekter`` or ``metadata``.
    """

    def ask(cursor: str | None) -> tuple[Page, Sequence[RawObject], str | None]:
        query = dict(params or {})
        if cursor is not None:
            query["start"] = cursor
        page = _page(client.get_json(path, query), path, cursor)
        return page, page.objects, page.next_cursor

    for page, _ in follow(ask, start, path, key=key):
        yield page


def _page(body: object, path: str, cursor: str | None) -> Page:
    """Check a page's outer form."""
    objects = body.get("objekter") if isinstance(body, dict) else None
    metadata = body.get("metadata") if isinstance(body, dict) else None
    if not isinstance(objects, list) or not isinstance(metadata, dict):
        wrong = "objekter" if not isinstance(objects, list) else "metadata"
        msg = f"A page of {path} has no {wrong}: check that the API URL is API Les V4."
        raise SchemaError(msg)
    if not all(isinstance(item, dict) for item in objects):
        msg = f"A page of {path} has something other than objects in objekter: check that it is API Les V4."
        raise SchemaError(msg)
    neste = metadata.get("neste")
    next_cursor = neste.get("start") if isinstance(neste, dict) else None
    if next_cursor is not None and not isinstance(next_cursor, str):
        msg = f"A page of {path} has a metadata.neste.start that is not text: check that it is API Les V4."
        raise SchemaError(msg)
    return Page(tuple(objects), cursor, next_cursor)
