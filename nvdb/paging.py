"""The only paging loop.

API Les V4 never says "last page": ``neste`` is always there, and the end is an empty page that repeats the
cursor. A page may be short without being the last (pages are limited by size), and a query without hits
gives an empty page without ``neste``. The cursor is followed, not ``neste.href``: no answer can lead to
another host.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from nvdb.client import NvdbClient, Params
from nvdb.errors import PagingError, SchemaError

RawObject = Mapping[str, Any]


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


def id_and_version(item: RawObject) -> object:
    """Tell a vegobjekt's version from every other: its id and ``metadata.versjon``."""
    metadata = item.get("metadata")
    return item.get("id"), metadata.get("versjon") if isinstance(metadata, dict) else None


def iter_pages(
    client: NvdbClient,
    path: str,
    params: Params | None = None,
    start: str | None = None,
    *,
    key: Callable[[RawObject], object] = id_and_version,
) -> Iterator[Page]:
    """Yield the pages of a query until its end; nothing for a query without hits.

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
        Object → what no other object of the query has: a page is known again by the keys on it. By default
        a vegobjekt's id and version; needed for whatever has no ``id``.

    Raises
    ------
    PagingError
        A page with objects whose cursor has been used before, or that holds exactly the objects of an earlier
        page: to stop there silently would lose whatever follows.
    SchemaError
        A page without ``objekter`` or ``metadata``.
    """
    cursor = start
    cursors = {cursor}
    contents: set[int] = set()
    while True:
        query = dict(params or {})
        if cursor is not None:
            query["start"] = cursor
        page = _page(client.get_json(path, query), path, cursor)
        if not page.objects:
            return
        content = hash(tuple(str(key(item)) for item in page.objects))
        if content in contents or (page.next_cursor is not None and page.next_cursor in cursors):
            msg = (
                f"The page of {path} after cursor {cursor or 'none'} leads back to where it came from "
                f"(next cursor {page.next_cursor}): start the sync again."
            )
            raise PagingError(msg)
        yield page
        if page.next_cursor is None:
            return
        contents.add(content)
        cursors.add(page.next_cursor)
        cursor = page.next_cursor


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
