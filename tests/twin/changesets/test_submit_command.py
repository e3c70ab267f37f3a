"""``twin submit``: an export's change sets against a local API Skriv, and back again."""

from __future__ import annotations

import json
import shutil
from contextlib import ExitStack
from copy import deepcopy
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from command_line import Twin
from skriv_of_store import SECRET, posts, skriv

import twin.changesets.build as accepted_findings
from nvdb.datakatalog import snapshot
from nvdb.endringssett import Geometri
from nvdb.objects import point_from_wkt
from nvdb.replay.skriv import SkrivReplayServer, SkrivWorld
from twin.cli.submit import PASSWORD

MOVED, MOVED_PLATE, WRONG_PLATE, MISSING, GONE_PLATE = (
    1042500106, 1042600108, 1042600114, 1042500115, 1042600119,
)  # fmt: skip


def _in_plan(geometri: Geometri | None) -> Any:
    """Place in plan and its quality."""
    if geometri is None:
        return None
    assert geometri.kvalitet is not None
    return point_from_wkt(geometri.wkt)[:2], geometri.kvalitet.noyaktighet_cm, geometri.datafangstdato


def said(world: SkrivWorld) -> dict[int, Any]:
    """What every object says, whichever version says it and by which operation it came."""
    return {
        number: (
            {n: (e.verdi, e.enum, _in_plan(e.geometri)) for n, e in item.egenskaper.items()},
            None if item.stedfesting is None else item.stedfesting.punkter,
            sorted(item.barn),
            item.sluttdato,
        )
        for number, item in world.objects.items()
    }


@pytest.mark.usefixtures("user")
def test_sample_goes_to_nvdb_and_back(twin: Twin, accepted: tuple[Path, Path], stack: ExitStack) -> None:
    """All four findings are carried out as found; the undo set makes every object say what it said."""
    store, out = accepted
    server = skriv(stack, store)
    before = deepcopy(said(server.world))
    trial = twin("submit", out, "--api-url", server.url)
    assert trial.code == 0
    assert "nothing was sent" in trial.err
    assert (posts(server), said(server.world)) == (0, before)

    answer = twin("submit", out, "--go", "--api-url", server.url, "--json")
    assert answer.code == 0
    (done,) = answer.json["sets"]
    assert done["accepted"]
    assert len(done["objects"]) == 7
    assert sum("without its height" in sentence for sentence in done["sentences"]) == 2
    objects = server.world.objects
    assert objects[WRONG_PLATE].egenskaper[5530].enum == (8874,)
    assert (objects[MOVED].versjon, objects[MOVED_PLATE].versjon) == (2, 2)
    assert objects[MISSING].sluttdato == objects[GONE_PLATE].sluttdato is not None
    new = sorted(objects.keys() - before.keys())
    assert [objects[number].type_id for number in new].count(96) == 2
    assert sorted(child for number in new for child in objects[number].barn) == [
        number for number in new if objects[number].type_id == 96
    ]

    back = twin("submit", out / done["undo"], "--go", "--api-url", server.url)
    assert back.code == 0
    assert said(server.world) == before


@pytest.mark.usefixtures("user")
def test_set_is_never_sent_twice(twin: Twin, accepted: tuple[Path, Path], stack: ExitStack) -> None:
    """Carried out, it is refused with exit code 5, also as JSON; at another API it is another matter."""
    store, out = accepted
    server = skriv(stack, store)
    assert twin("submit", out, "--go", "--api-url", server.url).code == 0
    for path in (out, out / "endringssett-1.json"):
        answer = twin("submit", path, "--go", "--api-url", server.url)
        assert answer.code == 5
        assert "4 findings are left out (4 carried out before" in answer.err
    assert posts(server) == 1
    other = skriv(stack, store)
    assert twin("submit", out, "--go", "--api-url", other.url).code == 0


@pytest.mark.usefixtures("user")
def test_set_that_was_not_waited_for_is_taken_up_again(
    twin: Twin, accepted: tuple[Path, Path], stack: ExitStack
) -> None:
    """Too short a wait is exit code 3; the next call asks on and does not register it again."""
    store, out = accepted
    server = skriv(stack, store, on_the_way=("BEHANDLES",))
    assert twin("submit", out, "--go", "--wait", 0, "--api-url", server.url).code == 3
    answer = twin("export", out, "--store", store)
    assert answer.code == 5
    assert "was sent and is not finished" in answer.err
    answer = twin("--verbose", "submit", out, "--go", "--api-url", server.url)
    assert answer.code == 0
    assert "was registered before" in answer.err
    assert posts(server) == 1
    assert twin("export", out, "--store", store).code == 0
    assert list(out.glob("endringssett-1-angre-*.xml"))


@pytest.mark.usefixtures("user")
def test_folder_of_several_sets_goes_on_where_it_stopped(
    twin: Twin, accepted: tuple[Path, Path], stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A refused set keeps no other back; the next call sends it alone; then nothing is left."""
    store, out = accepted
    small = partial(accepted_findings.endringssett, max_objects=3)
    monkeypatch.setattr(accepted_findings, "endringssett", small)
    assert twin("export", out, "--store", store).code == 0
    n = len(list(out.glob("endringssett-?.xml")))
    assert n == 3
    server = skriv(stack, store)
    server.world.objects[WRONG_PLATE].versjon = 2
    answer = twin("submit", out, "--go", "--api-url", server.url, "--json")
    assert answer.code == 4
    assert [item["accepted"] for item in answer.json["sets"]].count(True) == n - 1
    server.world.objects[WRONG_PLATE].versjon = 1
    answer = twin("submit", out, "--go", "--api-url", server.url, "--json")
    assert answer.code == 0
    assert [item["accepted"] for item in answer.json["sets"]] == [True]
    assert twin("submit", out, "--go", "--api-url", server.url).code == 5
    assert posts(server) == n + 1


@pytest.mark.usefixtures("user")
def test_content_that_nvdb_refuses_is_told_object_by_object(
    twin: Twin, accepted: tuple[Path, Path], stack: ExitStack
) -> None:
    """A version that is not the newest: exit code 4, nothing changed, and the object is named."""
    store, out = accepted
    server = skriv(stack, store)
    server.world.objects[WRONG_PLATE].versjon = 2
    before = deepcopy(said(server.world))
    answer = twin("submit", out, "--go", "--api-url", server.url, "--json")
    assert answer.code == 4
    (done,) = answer.json["sets"]
    (refused,) = [item for item in done["objects"] if item["nvdb_id"] == WRONG_PLATE]
    assert "VERSJONSKONFLIKT" in refused["result"]
    assert (done["undo"], said(server.world)) == (None, before)
    table = twin("submit", out, "--go", "--api-url", server.url)
    assert table.code == 4
    assert "VERSJONSKONFLIKT" in table.out


@pytest.mark.usefixtures("user")
def test_validator_of_the_api_has_a_say_in_the_trial(
    twin: Twin, accepted: tuple[Path, Path], stack: ExitStack
) -> None:
    """What it refuses without sending is exit code 4: a datakatalog in which no type is known."""
    store, out = accepted
    server = skriv(stack, store)
    server.world.katalog = type(snapshot())("2.38", "", {}, {}, {})
    assert twin("submit", out, "--api-url", server.url).code == 4
    assert twin("submit", out, "--go", "--api-url", server.url).code == 4
    assert posts(server) == 0


@pytest.mark.usefixtures("no_waiting")
def test_network_and_login_have_their_exit_codes(
    twin: Twin, accepted: tuple[Path, Path], stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No user 2, nobody there 3, a wrong password or no role 5; without a user the checks are our own."""
    store, out = accepted
    monkeypatch.delenv("TWIN_SKRIV_USER", raising=False)
    answer = twin("submit", out)
    assert answer.code == 0
    assert "our own checks" in answer.err
    assert twin("submit", out, "--go").code == 2
    monkeypatch.setenv(PASSWORD, SECRET)
    user = ["--user", "olanor", "--api-url"]
    server = skriv(stack, store, roles=False)
    answer = twin("submit", out, "--go", *user, server.url)
    assert answer.code == 5
    assert "role" in answer.err
    monkeypatch.setenv(PASSWORD, "wrong")
    answer = twin("submit", out, "--go", *user, server.url)
    assert answer.code == 5
    assert "wrong" not in answer.err.replace("TWIN", "")
    with SkrivReplayServer(SkrivWorld(), users={}) as gone:
        url = gone.url
    assert twin("submit", out, *user, url).code == 3


def test_submit_refuses_what_was_not_accepted_or_was_changed(
    twin: Twin, accepted: tuple[Path, Path], matched_road: Path, tmp_path: Path
) -> None:
    """A preview, a set or its earlier states edited since, a set of an earlier export: 5; no file: 4."""
    _, out = accepted
    store, preview = Path(shutil.copy(matched_road, tmp_path / "open.db")), tmp_path / "preview"
    assert twin("export", preview, "--decision", "open", "--store", store).code == 0
    assert twin("submit", preview).code == 5
    assert twin("submit", preview / "preview-endringssett-1.xml").code == 5
    assert twin("submit", tmp_path / "nothing").code == 4
    for name in ("endringssett-1.xml", "endringssett-1-before.json"):
        path = out / name
        content = path.read_bytes()
        path.write_bytes(content.replace(b"1042", b"1043"))
        answer = twin("submit", out)
        assert answer.code == 5
        assert f"{name} is not as" in answer.err
        path.write_bytes(content)
    assert twin("submit", out).code == 0
    shutil.copy(out / "endringssett-1.xml", out / "endringssett-2.xml")
    assert twin("submit", out / "endringssett-2.xml").code == 5
    (tmp_path / "other.xml").write_text("<gpx/>")
    assert twin("submit", tmp_path / "other.xml").code == 4


def test_set_of_somebody_else_is_checked_by_our_rules(
    twin: Twin, accepted: tuple[Path, Path], tmp_path: Path
) -> None:
    """A file without provenance is checked too: an object with two operations is exit code 4."""
    _, out = accepted
    text = (out / "endringssett-1.json").read_text(encoding="utf-8")
    sett = json.loads(text)
    sett["delvisOppdater"]["vegobjekter"] *= 2
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(sett), encoding="utf-8")
    answer = twin("submit", path)
    assert answer.code == 4
    assert "2 operations in one set" in answer.err


@pytest.mark.usefixtures("user")
def test_damaged_receipts_stop_the_sending(twin: Twin, accepted: tuple[Path, Path], stack: ExitStack) -> None:
    """Where it is not known what was sent before, nothing is sent."""
    store, out = accepted
    server = skriv(stack, store)
    (out / "kvittering.json").write_text("{")
    answer = twin("submit", out, "--go", "--api-url", server.url)
    assert answer.code == 5
    assert "kvittering.json" in answer.err
    assert posts(server) == 0
