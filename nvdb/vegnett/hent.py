"""Fetch the segmented road network of an area from API Les V4."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date
from typing import TYPE_CHECKING, Final

from nvdb.client.paging import Page, RawObject, iter_pages

if TYPE_CHECKING:
    from nvdb.area import Area
    from nvdb.client.client import NvdbClient

SEGMENTERT: Final = "/vegnett/api/v4/veglenkesekvenser/segmentert"
PAGE_SIZE: Final = 1000


def hent_vegnett(
    client: NvdbClient,
    area: Area,
    *,
    tidspunkt: date | None = None,
    historisk: bool = False,
    antall: int = PAGE_SIZE,
    start: str | None = None,
) -> Iterator[Page]:
    """Yield the pages of the segmented road network of an area, in UTM33 with NN2000 heights.

    Parameters
    ----------
    client : NvdbClient
    area : Area
        Any: the API selects by kommune, fylke, kontraktsområde and box.
    tidspunkt : date, optional
        The network as it was on that day; today's if left out.
    historisk : bool
        Also links that no longer are (keep them for a drive in the past).
    antall : int
        Links a page at most; the API may send fewer.
    start : str, optional
        Cursor to go on from: ``next_cursor`` of the last page that was kept.

    Yields
    ------
    Page
        Raw links for :meth:`nvdb.vegnett.Vegnett.from_les_v4`, and the cursors on both sides.

    Raises
    ------
    NvdbError
        As :func:`nvdb.client.paging.iter_pages`.
    """
    params: dict[str, str | int] = {"srid": "5973", "antall": antall, **area.params()}
    if tidspunkt is not None:
        params["tidspunkt"] = tidspunkt.isoformat()
    if historisk:
        params["historisk"] = "true"
    return iter_pages(client, SEGMENTERT, params, start, key=_referanse)


def _referanse(link: RawObject) -> object:
    """Tell a link from every other: it has no id and no version, and its ``referanse`` is unique."""
    return link.get("referanse")
