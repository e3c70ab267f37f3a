"""The replayed road network: filtered, cut into pages, and read from a folder beside recorded vegobjekter."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import pytest
from vegnett_links import link_in_oslo

from nvdb.area import Area
from nvdb.errors import HttpStatusError
from nvdb.replay import ReplayWorld
from nvdb.vegnett import SEGMENTERT, Vegnett, hent_vegnett

NOW = datetime(2026, 6, 1, 12, tzinfo=UTC)


def _ids(client: Any, **options: Any) -> list[int]:
    area = options.pop("area", Area())
    return [
        link["veglenkesekvensid"] for page in hent_vegnett(client, area, **options) for link in page.objects
    ]


@pytest.mark.parametrize("antall", [1, 2, 3, 7, 1000])
def test_replayed_network_comes_whole_in_pages_of_any_size(api: Any, antall: int) -> None:
    """Every segment once, ordered, also where one veglenkesekvens spans pages and pages come short."""
    pieces = [
        link_in_oslo(3, veglenkenummer=nummer, segmentnummer=segment, referanse=f"5003-{nummer}-{segment}")
        for nummer, segment in ((10, 1), (2, 10), (2, 9))
    ]
    links = [link_in_oslo(4), *pieces, link_in_oslo(1), link_in_oslo(2)]
    world = ReplayWorld(vegnett=links)
    world.page_limit = 5
    client, _ = api.serve(world)
    found = [link for page in hent_vegnett(client, Area(), antall=antall) for link in page.objects]
    keys = [(link["veglenkesekvensid"], link["veglenkenummer"], link["segmentnummer"]) for link in found]
    assert keys == [(5001, 1, 1), (5002, 1, 1), (5003, 2, 9), (5003, 2, 10), (5003, 10, 1), (5004, 1, 1)]


def test_replayed_network_is_filtered_as_asked(api: Any) -> None:
    """By kommune, by box (a segment that crosses it counts), by day, and ended ones only when asked for."""
    ended = {"startdato": "2010-01-01", "sluttdato": "2026-06-01"}
    links = [
        link_in_oslo(1),
        link_in_oslo(2, kommune=5001),
        link_in_oslo(3, metadata=ended),
        link_in_oslo(4, kommune=None),
    ]
    client, _ = api.serve(ReplayWorld(vegnett=links, clock=lambda: NOW))
    assert _ids(client) == [5001, 5002, 5004]
    assert _ids(client, historisk=True) == [5001, 5002, 5003, 5004]
    assert _ids(client, tidspunkt=date(2026, 5, 31)) == [5001, 5002, 5003, 5004]
    assert _ids(client, tidspunkt=date(2019, 1, 1)) == [5003]
    assert _ids(client, area=Area(kommuner=(301,))) == [5001]
    assert _ids(client, area=Area(kommuner=(301, 5001))) == [5001, 5002]
    assert _ids(client, area=Area(bbox=(260_500.0, 6_650_004.0, 262_000.0, 6_650_005.0))) == [5001, 5002]
    assert _ids(client, area=Area(bbox=(260_500.0, 6_650_011.0, 262_500.0, 6_650_500.0))) == []


def test_replayed_network_is_filtered_by_fylke_and_kontraktsomrade(api: Any) -> None:
    """A segment lies in one fylke and in any number of kontraktsområder, asked for by name or id."""
    contracts = [{"id": 17, "nummer": 9503, "navn": "9503 Hålogaland"}, {"id": 18, "navn": "Elektro"}]
    links = [link_in_oslo(1, fylke=3), link_in_oslo(2, fylke=50), link_in_oslo(3, kontraktsområder=contracts)]
    client, _ = api.serve(ReplayWorld(vegnett=links, clock=lambda: NOW))
    assert _ids(client, area=Area(fylker=(3,))) == [5001]
    assert _ids(client, area=Area(fylker=(3, 50))) == [5001, 5002]
    assert _ids(client, area=Area(fylker=(15,))) == []
    for name in ("17", "9503 Hålogaland", "Elektro"):
        assert _ids(client, area=Area(kontraktsomrader=(name,))) == [5003]


def test_replayed_network_counts_when_asked(api: Any) -> None:
    """``inkluderAntall`` gives the number of all segments that pass the filters, not of those on the page."""
    client, _ = api.serve(ReplayWorld(vegnett=[link_in_oslo(number) for number in range(5)]))
    body = client.get_json(SEGMENTERT, {"antall": 2, "inkluderAntall": "true"})
    assert (body["metadata"]["antall"], body["metadata"]["returnert"]) == (5, 2)
    assert body["metadata"]["neste"]["start"] == "5001-1-1"
    assert "antall" not in client.get_json(SEGMENTERT, {"antall": 2})["metadata"]


def test_replayed_folder_serves_network_and_vegobjekter_side_by_side(
    api: Any, tmp_path: Path, plate: Callable[..., Any]
) -> None:
    """Files ``vegnett*`` are the network, plain or packed; every other file holds vegobjekter as before."""
    (tmp_path / "signs.json").write_text(json.dumps({"objekter": [plate(501)], "metadata": {}}))
    page = {"objekter": [link_in_oslo(2), link_in_oslo(1)], "metadata": {}}
    (tmp_path / "vegnett-1.json").write_text(json.dumps(page))
    (tmp_path / "vegnett-2.json.gz").write_bytes(gzip.compress(json.dumps([link_in_oslo(3)]).encode()))
    client, server = api.serve(tmp_path)
    assert server.counts == {95: 0, 96: 1}
    objects = [link for found in hent_vegnett(client, Area()) for link in found.objects]
    assert objects == [link_in_oslo(1), link_in_oslo(2), link_in_oslo(3)]
    assert len(Vegnett.from_les_v4(objects)) == 3


def test_replayed_folder_without_network_says_so(api: Any, tmp_path: Path, plate: Callable[..., Any]) -> None:
    """An address that nothing was recorded of is not found, rather than an empty country."""
    (tmp_path / "signs.json").write_text(json.dumps({"objekter": [plate(501)], "metadata": {}}))
    client, _ = api.serve(tmp_path)
    with pytest.raises(HttpStatusError, match="vegnett") as caught:
        _ids(client)
    assert caught.value.status == 404


@pytest.mark.parametrize(
    "query", [{"srid": "4326"}, {"start": "x"}, {"kartutsnitt": "1,2"}, {"kommune": "Oslo"}]
)
def test_replayed_network_refuses_what_it_cannot_read(api: Any, query: dict[str, str]) -> None:
    """A query that cannot be honoured is a 400 that names the parameter."""
    client, _ = api.serve(ReplayWorld(vegnett=[link_in_oslo(1)]))
    with pytest.raises(HttpStatusError, match=next(iter(query))) as caught:
        client.get_json(SEGMENTERT, query)
    assert caught.value.status == 400
