"""A finding is carried out in NVDB once, whatever folder, address, copy, order or kill it goes through."""

from __future__ import annotations

import hashlib
import json
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from command_line import Answer, Twin
from skriv_of_store import SECRET, USER, decisions, new_signs, posts, skriv

from nvdb.client import NvdbClient
from nvdb.endringssett import from_xml, to_xml
from nvdb.replay.skriv import SkrivReplayServer
from nvdb.skriv import SKRIV_TEST_URL, SKRIV_URL, OidcLogin, SkrivClient
from twin.changesets.receipts import RECEIPTS
from twin.changesets.sent import SentLog, target_of
from twin.cli import run
from twin.errors import ConfigError
from twin.store import schema
from twin.store.store import Store

pytestmark = pytest.mark.usefixtures("user", "no_waiting")


@dataclass(frozen=True)
class Sender:
    """A store with one accepted finding, its export, and a local API Skriv with the mirror's objects."""

    twin: Twin
    store: Path
    server: SkrivReplayServer
    out: Path

    def go(self, path: Path | None = None, *options: object) -> Answer:
        """`twin submit --go` of the export, or of another folder or set."""
        return self.twin("submit", path or self.out, "--go", "--api-url", self.server.url, *options)

    def counts(self) -> tuple[int, int]:
        """How many sets were registered, and how many new signs there are."""
        return posts(self.server), new_signs(self.server, self.store)


@pytest.fixture
def sender(twin: Twin, new_sign: tuple[Path, Path], stack: ExitStack) -> Sender:
    """Everything is ready to be sent."""
    store, out = new_sign
    return Sender(twin, store, skriv(stack, store), out)


@pytest.mark.parametrize("spelling", ["{}/", "{}//", "HTTP://127.0.0.1:{port}", "http://localhost:{port}"])
def test_another_spelling_of_the_address_is_the_same_api(sender: Sender, twin: Twin, spelling: str) -> None:
    """A slash behind it, letters of the other case, another name of this machine: sent before."""
    assert sender.go().code == 0
    url = spelling.format(sender.server.url, port=sender.server.url.rpartition(":")[2])
    answer = twin("submit", sender.out, "--go", "--api-url", url)
    assert answer.code == 5
    assert "1 finding is left out (1 carried out before in " in answer.err
    assert sender.counts() == (1, 1)


def test_target_of_an_address_is_the_api_and_not_its_spelling() -> None:
    """The usual port, slashes, case, the documentation's address; the test environment is another API."""
    for url in (
        "HTTPS://NVDBapiskriv.atlas.vegvesen.no:443/",
        "https://nvdbapiskriv.atlas.vegvesen.no.",
        "https://www.vegvesen.no/nvdb//apiskriv/",
    ):
        assert target_of(url) == SKRIV_URL
    assert target_of(SKRIV_TEST_URL) == SKRIV_TEST_URL != SKRIV_URL
    assert target_of("http://[::1]:80/") == target_of("http://127.0.0.1") == "http://localhost"
    for url in ("", "nvdb", "ftp://nvdb", "http://nvdb:eighty", "http://[::1"):
        with pytest.raises(ConfigError, match="is not an http"):
            target_of(url)
    assert target_of("http://127.0.0.1:8080/a") != target_of("http://127.0.0.1:8081/a")


def test_what_went_to_one_api_did_not_go_to_another(
    twin: Twin, new_sign: tuple[Path, Path], stack: ExitStack
) -> None:
    """First the test environment, then NVDB, from one folder."""
    store, out = new_sign
    trial, real = skriv(stack, store), skriv(stack, store)
    assert twin("submit", out, "--go", "--api-url", trial.url).code == 0
    assert twin("export", out, "--api-url", real.url).code == 0
    assert twin("submit", out, "--go", "--api-url", real.url).code == 0
    assert [new_signs(server, store) for server in (trial, real)] == [1, 1]


def test_export_to_another_folder_is_not_sent_again(sender: Sender, twin: Twin, tmp_path: Path) -> None:
    """Before the next sync a finding is left out of an export, and of what is sent."""
    other = tmp_path / "other"
    assert twin("export", other).code == 0
    assert sender.go().code == 0
    assert sender.go(other).code == 5
    answer = twin("export", tmp_path / "third", "--api-url", sender.server.url)
    assert answer.code == 0
    assert "1 finding is left out (1 carried out before in " in answer.err
    assert not list((tmp_path / "third").glob("endringssett-*"))
    assert sender.counts() == (1, 1)


def test_copy_of_a_folder_is_not_sent_again(sender: Sender, tmp_path: Path) -> None:
    """Neither the copied folder nor one file out of it."""
    copy = Path(shutil.copytree(sender.out, tmp_path / "copy"))
    lone = Path(shutil.copy(sender.out / "endringssett-1.xml", tmp_path / "lone.xml"))
    assert sender.go().code == 0
    for path in (copy, lone):
        assert sender.go(path).code == 5
    assert sender.counts() == (1, 1)


def test_second_finding_goes_without_the_first(sender: Sender, twin: Twin) -> None:
    """One is sent, another accepted; exported without a sync, for another API first, only that is sent."""
    assert sender.go().code == 0
    assert twin("decide", "accept", "--verdict", "missing", "--by", "kari").code == 0
    assert twin("export", sender.out, "--api-url", SKRIV_TEST_URL).code == 0
    assert len(json.loads((sender.out / "proveniens.json").read_text())["changes"]) == 2
    answer = sender.go()
    assert answer.code == 0
    assert "1 finding is left out (1 carried out before in " in answer.err
    assert sender.counts() == (2, 1)
    assert sender.go().code == 5


def test_two_at_once_send_once(sender: Sender) -> None:
    """One of them sends, the others are told who is at work, or that all is done."""
    codes: list[int] = []
    start = threading.Barrier(4)

    def submit() -> None:
        start.wait()
        codes.append(run(["submit", str(sender.out), "--go", "--api-url", sender.server.url]))

    threads = [threading.Thread(target=submit) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(codes) == [0, 5, 5, 5]
    assert sender.counts() == (1, 1)


def test_answer_that_is_lost_does_not_register_again(sender: Sender, twin: Twin, tmp_path: Path) -> None:
    """The set is registered, its id was never heard of: the next call finds it at the API and starts it."""
    sender.server.lose.append("POST /rest/v3/endringssett")
    assert sender.go().code == 3
    assert sender.counts()[1] == 0
    answer = twin("export", tmp_path / "other", "--api-url", sender.server.url)
    assert "1 finding is left out (1 under way)" in answer.err
    assert sender.go().code == 0
    assert sender.counts() == (1, 1)
    assert list(sender.out.glob("endringssett-1-angre-*.xml"))


def test_set_that_was_not_started_is_cancelled_where_it_is_no_longer_accepted(sender: Sender) -> None:
    """Its answer was lost, then somebody dismissed the sign: nothing goes to NVDB, now or later."""
    sender.server.lose.append("POST /rest/v3/endringssett")
    assert sender.go().code == 3
    decisions(sender.store, new="dismiss")
    answer = sender.go()
    assert answer.code == 5
    assert "1 finding is left out (1 not accepted in this store as exported" in answer.err
    assert [path.rpartition("/")[2] for _, path in sender.server.requests if "kanseller" in path] == [
        "kanseller"
    ]
    decisions(sender.store, new="accept")
    assert sender.go().code == 0
    assert sender.counts()[1] == 1


def test_set_is_taken_up_from_any_folder(sender: Sender, twin: Twin, tmp_path: Path) -> None:
    """The folder that it was sent from is gone: it is finished all the same, without an undo set."""
    other = tmp_path / "other"
    sender.server.lose.append("POST /rest/v3/endringssett")
    assert sender.go().code == 3
    shutil.rmtree(sender.out)
    assert twin("export", other, "--api-url", sender.server.url).code == 0
    answer = sender.go(other)
    assert answer.code == 0
    assert "no set to undo it" in answer.err
    assert sender.counts() == (1, 1)


def test_finding_that_is_no_longer_accepted_is_not_sent(
    twin: Twin, accepted: tuple[Path, Path], stack: ExitStack
) -> None:
    """Dismissed after the export, it is left out, and the others are sent."""
    store, out = accepted
    server = skriv(stack, store)
    decisions(store, new="dismiss")
    answer = twin("submit", out, "--go", "--api-url", server.url)
    assert answer.code == 0
    assert "1 finding is left out (1 not accepted in this store as exported" in answer.err
    assert (posts(server), new_signs(server, store)) == (1, 0)


def test_folder_of_another_store_is_not_sent(
    twin: Twin, accepted: tuple[Path, Path], matched_store: Path, tmp_path: Path, stack: ExitStack
) -> None:
    """A store that did not accept these findings refuses, and says which command helps."""
    store, out = accepted
    server = skriv(stack, store)
    other = Path(shutil.copy(matched_store, tmp_path / "other.db"))
    answer = twin("submit", out, "--go", "--api-url", server.url, "--store", other)
    assert answer.code == 5
    assert "4 not accepted in this store as exported: match, decide and export again" in answer.err
    assert posts(server) == 0


def test_set_that_names_no_findings_is_sent_only_if_it_registers_nothing(
    sender: Sender, tmp_path: Path
) -> None:
    """As earlier versions of twin exported it: nobody could tell whether it was sent before."""
    text = (sender.out / "endringssett-1.xml").read_text(encoding="utf-8")
    head, _, rest = text.partition("<kontekst>")
    lone = tmp_path / "lone.xml"
    lone.write_text(head + rest.partition("</kontekst>")[2], encoding="utf-8")
    assert from_xml(lone.read_bytes()).kontekst is None
    answer = sender.go(lone)
    assert answer.code == 5
    assert "does not say which findings" in answer.err
    assert sender.counts()[0] == 0


@pytest.mark.parametrize("is_started", [True, False])
def test_copy_of_the_store_sends_nothing_that_the_other_has_sent(
    sender: Sender, tmp_path: Path, is_started: bool
) -> None:
    """The API is asked for sets of ours: one that is carried out or on the way keeps the copy from it."""
    late = tmp_path / "late.db"
    shutil.copy(sender.store, late)
    if not is_started:
        sender.server.lose.append("POST /rest/v3/endringssett")
    assert sender.go().code == (0 if is_started else 3)
    answer = sender.go(sender.out, "--store", late)
    assert answer.code == 5
    assert ("carried out before" if is_started else "from another copy of this store") in answer.err
    assert sender.counts()[0] == 1
    assert sender.go().code == (5 if is_started else 0)
    assert sender.counts()[1] == 1


def test_dry_run_of_a_set_holds_nothing(sender: Sender, stack: ExitStack) -> None:
    """Somebody tried the set from Python, and nothing was written: it is still to be sent."""
    client = client_of(stack, sender.server.url)
    assert client.submit(from_xml((sender.out / "endringssett-1.xml").read_bytes()), dry_run=True).accepted
    assert sender.counts()[1] == 0
    assert sender.go().code == 0
    assert sender.counts()[1] == 1


def test_two_copies_of_the_store_at_once_send_once(
    sender: Sender, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have asked, and found nothing, before either registered: the later one cancels its own."""
    late = tmp_path / "late.db"
    shutil.copy(sender.store, late)
    send, codes = SkrivClient.send, []

    def overtaken(client: SkrivClient, *arguments: object, **options: object) -> str:
        monkeypatch.setattr(SkrivClient, "send", send)
        codes.append(
            run(["submit", str(sender.out), "--go", "--api-url", sender.server.url, "--store", str(late)])
        )
        return send(client, *arguments, **options)

    monkeypatch.setattr(SkrivClient, "send", overtaken)
    answer = sender.go()
    assert (codes, answer.code) == ([0], 4)
    assert "another copy of this store" in answer.err
    assert sender.counts()[1] == 1


@pytest.mark.parametrize(("moved_m", "is_left_out"), [(0.3, True), (-0.9, True), (3.0, False)])
def test_renumbered_pole_is_not_sent_again(
    sender: Sender, twin: Twin, moved_m: float, is_left_out: bool
) -> None:
    """Ingested anew under another id before the next sync, it is left out; another pole near it is not."""
    assert sender.go().code == 0
    with Store.open(sender.store) as store, store.transaction() as connection:
        t = schema.change.c
        is_new = t.verdict == "new"
        connection.execute(
            sa.update(schema.change).where(is_new).values(change_id="abcabcabcabc", east_m=t.east_m + moved_m)
        )
    decisions(sender.store, new="accept")
    answer = twin("export", sender.out, "--api-url", sender.server.url)
    assert ("1 finding is left out (1 carried out before in " in answer.err) == is_left_out
    assert (sender.out / "endringssett-1.xml").exists() != is_left_out


def test_undone_sign_may_be_sent_again(sender: Sender) -> None:
    """The undo set removed it: a new export has it again, once; the same undo set is not sent twice."""
    answer = sender.go(sender.out, "--json")
    undo = sender.out / answer.json["sets"][0]["undo"]
    assert sender.go(undo).code == 0
    assert sender.counts()[1] == 0
    assert sender.go(undo).code == 5
    assert sender.go().code == 0
    assert sender.counts()[1] == 1


def test_carried_out_is_held_until_the_mirror_shows_it(sender: Sender) -> None:
    """Then match has the say, also when the sign is gone from the mirror again."""
    assert sender.go().code == 0
    with Store.open(sender.store) as store:
        log = SentLog(store, sender.server.url)
        (held,) = log.held().values()
        assert not SentLog(store, SKRIV_URL).held()
        for item in held.objects:
            tables = schema.MIRROR[item.type_id]
            row = store.rows(sa.select(tables.visible).limit(1))[0] | {"nvdb_id": item.nvdb_id}
            with store.transaction() as connection:
                connection.execute(sa.insert(tables.visible), [row])
        assert log.held() == {}
        for item in held.objects:
            tables = schema.MIRROR[item.type_id]
            with store.transaction() as connection:
                is_it = tables.visible.c.nvdb_id == item.nvdb_id
                row = dict(connection.execute(sa.select(tables.visible).where(is_it)).mappings().one())
                connection.execute(sa.insert(tables.history), [row | {"seen_until": "2026-11-22"}])
                connection.execute(sa.delete(tables.visible).where(is_it))
        assert log.held() == {}


@pytest.mark.slow
@pytest.mark.parametrize("state", ["carried out", "under way", "not started"])
def test_receipt_of_an_earlier_version_is_taken_over(
    twin: Twin, new_sign: tuple[Path, Path], stack: ExitStack, state: str
) -> None:
    """It sent the set and left `kvittering.json` beside it: what was sent then is not sent again."""
    on_the_way = ("BEHANDLES", "BEHANDLES") if state == "under way" else ()
    store, out = new_sign
    server = skriv(stack, store, on_the_way=on_the_way)
    set_id = earlier_version_sends(stack, server.url, out, start=state != "not started")
    if state == "under way":
        assert twin("export", out, "--api-url", server.url).code == 5
    answer = twin("submit", out, "--go", "--api-url", server.url)
    assert answer.code == (0 if state == "under way" else 5)
    assert bool(list(out.glob("endringssett-1-angre-*.xml"))) == (state == "under way")
    if state == "not started":
        assert "`twin export` it again" in answer.err
        assert twin("export", out, "--api-url", server.url).code == 0
        assert twin("submit", out, "--go", "--api-url", server.url).code == 0
    assert new_signs(server, store) == 1
    assert posts(server) == (2 if state == "not started" else 1)
    assert [path for _, path in server.requests if path.endswith(f"{set_id}/kanseller")] == (
        [f"/rest/v3/endringssett/{set_id}/kanseller"] if state == "not started" else []
    )
    assert twin("export", out, "--api-url", server.url).code == 0
    assert not list(out.glob("endringssett-?.xml"))


def client_of(stack: ExitStack, url: str) -> SkrivClient:
    """A user of the local server, in Python."""
    http = stack.enter_context(NvdbClient(url))
    return SkrivClient(http, OidcLogin(http, lambda: (USER, SECRET)))


def earlier_version_sends(stack: ExitStack, url: str, out: Path, *, start: bool) -> str:
    """Send a set as twin did before the store knew what was sent, and leave its receipt."""
    client = client_of(stack, url)
    path, provenance = out / "endringssett-1.xml", out / "proveniens.json"
    sett = replace(from_xml(path.read_bytes()), kontekst=None)
    path.write_bytes(to_xml(sett))
    document = json.loads(provenance.read_text())
    document["sets"][0]["sha256"][path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
    provenance.write_text(json.dumps(document))
    set_id = client.send(sett)
    if start:
        client.start(set_id)
    receipt = {"set_id": set_id, "fremdrift": "IKKE_STARTET", "file": path.name}
    sha256 = hashlib.sha256(to_xml(sett)).hexdigest()
    (out / RECEIPTS).write_text(json.dumps({f"{url}/": {sha256: receipt}}))
    return set_id


@pytest.mark.slow
@pytest.mark.file
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no SIGKILL here")
@pytest.mark.parametrize("end", ["/rest/v3/endringssett", "/start"])
def test_process_that_is_killed_is_finished_by_the_next(sender: Sender, end: str) -> None:
    """Killed when API Skriv has done what was asked and before the answer is heard: registered once."""
    answer = sender.server.answer

    def last(method: str, path: str, *rest: Any) -> Any:
        given = answer(method, path, *rest)
        if path.endswith(end) and method == "POST":
            child.kill()
            child.wait()
        return given

    sender.server.answer = last  # type: ignore[method-assign]
    with subprocess.Popen(
        [sys.executable, "-m", "twin", "submit", str(sender.out), "--go", "--api-url", sender.server.url],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as child:
        try:
            assert child.wait(timeout=300) == -signal.SIGKILL
        finally:
            child.kill()
    sender.server.answer = answer  # type: ignore[method-assign]
    assert sender.go().code == 0
    assert sender.counts() == (1, 1)
    assert sender.go().code == 5
