"""The replay server answers as V4 does."""

from __future__ import annotations

import gzip
import json
import signal
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from checkout import ROOT

from nvdb.client import NvdbClient
from nvdb.errors import HttpStatusError, ReplaySourceError
from nvdb.objects import position_from_wkt
from nvdb.replay import Fault, ReplayServer
from nvdb.replay.server import main

PATH = "/vegobjekter/96"


@pytest.fixture
def plates(plate: Any) -> list[dict[str, Any]]:
    """Five plates, the fifth in Oslo."""
    found = [plate(number) for number in (701, 702, 703, 704, 705)]
    found[4]["lokasjon"]["kommuner"] = [301, 5001]
    return found


def _get(client: NvdbClient, path: str = PATH, **params: Any) -> dict[str, Any]:
    body = client.get_json(path, params)
    assert isinstance(body, dict)
    return body


def _ids(body: dict[str, Any]) -> list[int]:
    return [item["id"] for item in body["objekter"]]


def test_replay_pages_as_v4_does(api: Any, plates: Any) -> None:
    """Cursor id:versjon, href with the same query, and an empty page with the same cursor at the end."""
    client, server = api.serve({96: plates})
    first = _get(client, kommune="5001", antall=3)
    assert _ids(first) == [701, 702, 703]
    assert first["metadata"]["returnert"] == first["metadata"]["sidestørrelse"] == 3
    neste = first["metadata"]["neste"]
    assert neste == {"start": "703:2", "href": f"{server.url}{PATH}?kommune=5001&start=703:2&antall=3"}
    second = _get(client, neste["href"])
    assert _ids(second) == [704, 705]
    end = _get(client, second["metadata"]["neste"]["href"])
    assert (end["objekter"], end["metadata"]["returnert"]) == ([], 0)
    assert end["metadata"]["neste"]["start"] == second["metadata"]["neste"]["start"] == "705:2"


def test_replay_of_no_hits_names_no_next(api: Any, plates: Any) -> None:
    """A query without hits is an empty page without ``neste``."""
    client, _ = api.serve({96: plates})
    assert _get(client, kommune="1151") == {
        "objekter": [],
        "metadata": {"returnert": 0, "sidestørrelse": 1000},
    }
    assert _get(client, "/vegobjekter/95")["objekter"] == []


def test_replay_has_both_addresses_of_v4(api: Any, plates: Any) -> None:
    """The short address and the versioned one give the same page."""
    client, _ = api.serve({96: plates})
    assert _get(client, "/vegobjekter/api/v4/vegobjekter/96") == _get(client)


@pytest.mark.parametrize(
    ("params", "ids"),
    [
        ({"kommune": "301"}, [705]),
        ({"kommune": "301,5001"}, [701, 702, 703, 704, 705]),
        ({"ider": "704,702,999"}, [702, 704]),
        ({"kartutsnitt": "269999, 7040702, 270001, 7040703.5"}, [702, 703]),
        ({"kartutsnitt": "0,0,1,1"}, []),
        ({"ider": "702", "kommune": "301"}, []),
    ],
)
def test_replay_filters_objects_and_counts_alike(api: Any, plates: Any, params: Any, ids: list[int]) -> None:
    """Each filter gives its objects, and statistikk and inkluderAntall count the same ones."""
    client, _ = api.serve({96: plates})
    body = _get(client, **params, inkluderAntall="true")
    assert _ids(body) == ids
    assert body["metadata"]["antall"] == len(ids)
    assert _get(client, f"{PATH}/statistikk", **params) == {"antall": len(ids), "lengde": 0.0}


def test_replay_shows_the_parts_that_are_asked_for(api: Any, plates: Any) -> None:
    """Without inkluder only id and href come; alle brings every part; a list brings those."""
    client, server = api.serve({96: plates})
    assert _get(client)["objekter"][0] == {"id": 701, "href": f"{server.url}/vegobjekter/96/701"}
    assert set(_get(client, inkluder="egenskaper,geometri")["objekter"][0]) == {
        "id", "href", "egenskaper", "geometri",
    }  # fmt: skip
    whole = _get(client, inkluder="alle", srid="5973")["objekter"][0]
    assert {name: whole[name] for name in plates[0]} == plates[0]


def test_replay_converts_geometri_and_not_the_property(api: Any, plates: Any) -> None:
    """In 4326 ``geometri`` is latitude longitude with 8 decimals; the property stays in UTM33."""
    plates[1]["geometri"]["wkt"] = "POINT(270000.5 7040702.25)"
    plates[2]["geometri"]["wkt"] = "POINT Z (270000.5 7040702.25 -999999)"
    client, _ = api.serve({96: plates})
    body = _get(client, inkluder="geometri,egenskaper", srid="4326")
    first, second, third = body["objekter"][:3]
    assert first["egenskaper"][-1]["verdi"] == "POINT Z (270000.0 7040701.0 42.5)"
    assert first["geometri"]["srid"] == 4326
    assert first["geometri"]["wkt"].endswith(" 42.5)")
    lat, lon = (float(text) for text in second["geometri"]["wkt"].removeprefix("POINT(")[:-1].split())
    assert 63.3 < lat < 63.5
    assert 10.3 < lon < 10.5
    assert third["geometri"]["wkt"].endswith(" -999999)")
    # 8 decimals of a degree are 1 mm.
    position, _ = position_from_wkt(second["geometri"]["wkt"], 4326)
    assert position.east_m == pytest.approx(270000.5, abs=2e-3)
    assert position.north_m == pytest.approx(7040702.25, abs=2e-3)
    utm32 = _get(client, inkluder="geometri", srid="UTM32")["objekter"][1]["geometri"]
    assert utm32["srid"] == 5972
    assert position_from_wkt(utm32["wkt"], 5972)[0].east_m == pytest.approx(270000.5, abs=2e-3)


def test_replay_gives_one_object_and_the_root(api: Any, plates: Any) -> None:
    """An id gives the whole object; the root tells what there is."""
    client, _ = api.serve({96: plates})
    assert _get(client, f"{PATH}/703")["egenskaper"] == plates[2]["egenskaper"]
    assert _get(client, "/") == {"status": "OK", "vegobjekter": {"95": 0, "96": 5}}


@pytest.mark.parametrize(
    ("path", "params", "status", "detail"),
    [
        ("/vegobjekter/96/1", {}, 404, "Fant ikke vegobjekt 1"),
        ("/vegobjekter/105", {}, 404, "Vegobjekttype 105 finnes ikke"),
        ("/vegnett", {}, 404, "No static resource vegnett"),
        (PATH, {"start": "x"}, 400, "start: 'x'"),
        (PATH, {"antall": "0"}, 400, "antall: '0'"),
        (PATH, {"kommune": "Oslo"}, 400, "kommune: 'Oslo'"),
        (PATH, {"ider": ""}, 400, "ider: ''"),
        (PATH, {"kartutsnitt": "1,2"}, 400, "kartutsnitt: '1,2'"),
        (PATH, {"srid": "3857"}, 400, "srid: '3857'"),
        (PATH, {"inkluder": "alt"}, 400, "inkluder: 'alt'"),
    ],
)
def test_replay_answers_a_bad_question_with_problem_detail(
    api: Any, plates: Any, path: str, params: Any, status: int, detail: str
) -> None:
    """What V4 does not know is 404 or 400 with a ProblemDetail that says what."""
    client, _ = api.serve({96: plates})
    with pytest.raises(HttpStatusError) as caught:
        client.get_json(path, params)
    assert caught.value.status == status
    assert caught.value.detail.startswith(detail)


def _page(objects: list[Any], query: str = "") -> dict[str, Any]:
    neste = {"start": "1:1", "href": f"https://nvdb.invalid/vegobjekter/96?{query}&start=1:1"}
    return {"objekter": objects, "metadata": {"returnert": len(objects), "neste": neste}}


def test_replay_reads_every_form_of_recording(api: Any, plates: Any, tmp_path: Path) -> None:
    """Pages, compressed pages, lists and lines give the same objects; other answers are passed over."""
    (tmp_path / "a_page.json").write_text(json.dumps(_page(plates[:1])), encoding="utf-8")
    (tmp_path / "b.json.gz").write_bytes(gzip.compress(json.dumps(_page(plates[1:2])).encode()))
    (tmp_path / "c.json").write_text(json.dumps(plates[2:3]), encoding="utf-8")
    (tmp_path / "d.ndjson").write_text(
        "".join(json.dumps(raw) + "\n" for raw in plates[3:]), encoding="utf-8"
    )
    (tmp_path / "kommuner.json").write_text('[{"id": 1, "navn": "Oslo"}]', encoding="utf-8")
    (tmp_path / "status.json").write_text('"ok"', encoding="utf-8")
    (tmp_path / "README.md").write_text("not JSON", encoding="utf-8")
    client, server = api.serve(tmp_path)
    assert server.counts == {95: 0, 96: 5}
    assert _get(client)["objekter"] == plates


def test_replay_knows_kommune_and_type_of_a_bare_page_from_its_next(api: Any, tmp_path: Path) -> None:
    """Objects recorded without metadata and lokasjon belong to the type and kommune of the page's query."""
    (tmp_path / "oslo.json").write_text(
        json.dumps(_page([{"id": 5}, {"id": 6}], "kommune=301")), encoding="utf-8"
    )
    (tmp_path / "utsira.json").write_text(json.dumps(_page([{"id": 7}], "kommune=1151")), encoding="utf-8")
    client, _ = api.serve(tmp_path)
    assert _ids(_get(client, kommune="301")) == [5, 6]
    assert _ids(_get(client, kommune="1151,301")) == [5, 6, 7]


def test_replay_serves_the_newest_version_of_an_object(api: Any, plate: Any, tmp_path: Path) -> None:
    """The same object on two pages is served once, in its highest version, in the kommuner of both."""
    old = plate(701, lokasjon={"kommuner": [301]})
    new = plate(701)
    new["metadata"] = new["metadata"] | {"versjon": 3}
    (tmp_path / "1.json").write_text(json.dumps([new]), encoding="utf-8")
    (tmp_path / "2.json").write_text(json.dumps([old]), encoding="utf-8")
    client, _ = api.serve(tmp_path)
    (found,) = _get(client, kommune="301")["objekter"]
    assert found["metadata"]["versjon"] == 3


def test_replay_serves_objects_that_break_the_form(api: Any, plate: Any) -> None:
    """A client must survive a broken object: the server serves it as it is."""
    client, _ = api.serve({96: [plate(701, metadata=[]), plate(702, geometri={"wkt": 7})]})
    first, second = _get(client, inkluder="alle")["objekter"]
    assert (first["metadata"], second["geometri"]) == ([], {"wkt": 7})


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("a.json", b"{", "is not JSON"),
        ("a.json", b"\xff", "cannot be read"),
        ("a.json.gz", b"x", "cannot be read"),
        ("a.json.gz", gzip.compress(b"[]", mtime=0)[:-9] + b"\xff" * 9, "cannot be read"),
        ("a.json", b'{"objekter": [{"id": 1}], "metadata": {}}', "An object of a.json"),
        ("a.ndjson", b'{"id": 1}\nx\n', "is not JSON"),
        ("a.json", b'{"objekter": []}', "holds no vegobjekter"),
        ("a.txt", b"", "holds no vegobjekter"),
    ],
)
def test_replay_refuses_a_folder_it_cannot_serve(tmp_path: Path, name: str, content: bytes, why: str) -> None:
    """Damaged files and folders without objects are one sentence with the file's name."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ReplaySourceError, match=why):
        ReplayServer(tmp_path)


def test_replay_refuses_objects_without_an_id_and_a_folder_that_is_not_there(tmp_path: Path) -> None:
    """Generated objects need an id; a missing folder is named."""
    with pytest.raises(ReplaySourceError, match="Object 1 of type 96"):
        ReplayServer({96: [{"id": 1}, {"navn": "x"}]})
    with pytest.raises(ReplaySourceError, match="is not a folder"):
        ReplayServer(tmp_path / "nowhere")


def test_replay_tells_when_its_port_is_taken(plates: Any) -> None:
    """A port in use, or an impossible one, is ReplaySourceError; outside the block there is no URL."""
    server = ReplayServer({96: plates})
    with pytest.raises(ReplaySourceError, match="not running"):
        _ = server.url
    with server:
        for port in (urlsplit(server.url).port or 0, 99999):
            with pytest.raises(ReplaySourceError, match="cannot be used"):
                ReplayServer({96: plates}, port=port).__enter__()


def test_replay_answers_several_clients_at_once(api: Any, plates: Any) -> None:
    """Eight threads get whole pages, and every request is in the list once."""
    _, server = api.serve({96: plates})
    clients = [api.client(server.url) for _ in range(8)]
    with ThreadPoolExecutor(8) as pool:
        bodies = list(pool.map(lambda client: [_ids(_get(client)) for _ in range(5)], clients))
    assert bodies == [[[701, 702, 703, 704, 705]] * 5] * 8
    assert [request.number for request in server.requests] == list(range(40))


def test_replay_closes_though_a_client_hangs_on(plates: Any) -> None:
    """A connection that says nothing and a drip in progress do not keep the server from closing."""
    with ReplayServer({96: plates}, faults=[Fault("drip", pause_s=30.0)]) as server:
        address = urlsplit(server.url)
        assert address.hostname is not None
        silent = socket.create_connection((address.hostname, address.port or 0))
        dripping = socket.create_connection((address.hostname, address.port or 0))
        dripping.sendall(b"GET /vegobjekter/96 HTTP/1.1\r\nHost: x\r\nX-Client: t\r\n\r\n")
        assert dripping.recv(16).startswith(b"HTTP/1.1 200")
    with silent, dripping:
        assert silent.recv(1) == b""


@pytest.mark.skipif(sys.platform == "win32", reason="a Ctrl-C for one child process is POSIX")
def test_replay_command_serves_a_folder_until_it_is_interrupted(plates: Any, tmp_path: Path) -> None:
    """``python -m nvdb.replay FOLDER --port 0`` prints its address, serves, and ends well with Ctrl-C."""
    (tmp_path / "page.json").write_text(json.dumps(_page(plates)), encoding="utf-8")
    command = [sys.executable, "-W", "error", "-m", "nvdb.replay", str(tmp_path), "--port", "0"]

    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    ) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert "5 of type 96" in line
            with NvdbClient(line.split()[0]) as client:
                assert _ids(_get(client)) == [701, 702, 703, 704, 705]
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=300)
        finally:
            process.kill()
    assert (process.returncode, errors) == (0, "")


def test_replay_command_names_a_folder_it_cannot_serve(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A folder without pages is one sentence on stderr and exit code 4."""
    assert main([str(tmp_path)]) == 4
    assert "holds no vegobjekter" in capsys.readouterr().err
