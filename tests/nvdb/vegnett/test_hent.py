"""Fetching the segmented network, from a server that pages as API Les V4 does."""

from __future__ import annotations

from datetime import date
from typing import Any

import pytest
from vegnett_links import link_in_oslo

from nvdb.area import Area
from nvdb.errors import PagingError, SchemaError
from nvdb.replay import Fault, ReplayWorld
from nvdb.vegnett import SEGMENTERT, hent_vegnett

OSLO = Area(kommuner=(301,))


def _links(number: int) -> ReplayWorld:
    return ReplayWorld(vegnett=[link_in_oslo(k) for k in range(number)])


def test_hent_vegnett_asks_for_utm33_and_the_area(api: Any) -> None:
    """The question names the system, the kommune or the box, and the day if one is given."""
    client, server = api.serve(_links(1))
    list(hent_vegnett(client, OSLO))
    asked = len(server.requests)
    box = Area(bbox=(265_273.0, 7_019_372.0, 346_553.0, 7_061_071.0))
    list(hent_vegnett(client, box, tidspunkt=date(2024, 6, 1), historisk=True, antall=10))
    questions = server.requests[0], server.requests[asked]
    assert [question.path for question in questions] == [SEGMENTERT, SEGMENTERT]
    assert [question.query for question in questions] == [
        {"srid": "5973", "antall": "1000", "kommune": "301"},
        {
            "srid": "5973",
            "antall": "10",
            "kartutsnitt": "265273.000,7019372.000,346553.000,7061071.000",
            "tidspunkt": "2024-06-01",
            "historisk": "true",
        },
    ]


def test_hent_vegnett_goes_on_from_a_saved_cursor(api: Any) -> None:
    """What follows a page's next_cursor is the rest, without loss or repetition."""
    client, _ = api.serve(_links(5))
    first = next(hent_vegnett(client, OSLO, antall=2))
    rest = hent_vegnett(client, OSLO, antall=2, start=first.next_cursor)
    assert [link["veglenkesekvensid"] for page in rest for link in page.objects] == [5002, 5003, 5004]


def test_hent_vegnett_notices_a_cursor_that_leads_back(api: Any) -> None:
    """A page that comes again is an error: whatever follows it would be lost."""
    client, _ = api.serve(_links(4), faults=[None, Fault("repeat_cursor")])
    with pytest.raises(PagingError):
        list(hent_vegnett(client, OSLO, antall=2))


def test_hent_vegnett_notices_a_page_that_comes_again(api: Any) -> None:
    """The same links under a new cursor are an error: the links' references tell."""
    client, _ = api.serve(_links(4), faults=[None, Fault("repeat_page")])
    with pytest.raises(PagingError):
        list(hent_vegnett(client, OSLO, antall=2))


def test_hent_vegnett_refuses_what_is_not_a_page(api: Any) -> None:
    """An answer whose objects are no objects is named for what it is."""
    page = Fault("status", status=200, body=b'{"objekter": ["not a link"], "metadata": {}}')
    client, _ = api.serve(_links(1), faults=[page])
    with pytest.raises(SchemaError, match="objekter"):
        list(hent_vegnett(client, OSLO))
