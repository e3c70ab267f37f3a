"""Random histories of deciding, exporting, sending, undoing, syncing and matching, against a model.

API Skriv is the repository's local one on a real socket, NVDB's reading side the replay server: what a sync
fetches is what the change sets have made of the world, at once or, where Les lags, later.
"""

from __future__ import annotations

import json
import math
import random
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import sqlalchemy as sa
from sending_country import AREA, Country, without_poles
from skriv_of_store import SECRET, USER, world_of

from nvdb.client import NvdbClient
from nvdb.endringssett import Endringssett
from nvdb.errors import NvdbError
from nvdb.replay import ReplayServer, ReplayWorld
from nvdb.replay.skriv import SkrivReplayServer
from nvdb.skriv import IKKE_STARTET, OidcLogin, SkrivClient
from twin.changesets import files_of, groups_from_store
from twin.changesets.files import is_change_set_file
from twin.changesets.kontekst import groups_in
from twin.changesets.receipts import refuse_if_pending
from twin.changesets.sent import SentLog
from twin.changesets.submit import submit
from twin.decisions import decide
from twin.errors import TwinError
from twin.matching import match
from twin.mirror.sync import sync_nvdb
from twin.store import schema
from twin.store.kinds import QUIET, Decision, Verdict
from twin.store.store import Store

FOLDERS = ("out", "other", "third")
MOST_INSTANTS = 120
"""About as many as sending one set has."""
STEPS = 9


class KilledError(BaseException):
    """The process ends here: nothing of ours may run any more."""


@dataclass
class Instants:
    """Requests, SQL statements, commits and files written, counted; at one of them the process is killed."""

    left: int | None = None
    thread: int | None = None

    def __call__(self) -> None:
        """Count one."""
        if self.left is None or threading.get_ident() != self.thread:
            return
        self.left -= 1
        if self.left < 0:
            raise KilledError

    @contextmanager
    def armed(self, n: int) -> Iterator[None]:
        """Kill this thread at the n-th instant."""
        self.left, self.thread = n, threading.get_ident()
        try:
            yield
        finally:
            self.left = None


INSTANTS = Instants()


@contextmanager
def counted() -> Iterator[None]:
    """Have every instant counted, before and after each request and write."""

    def around(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            INSTANTS()
            answer = function(*arguments, **options)
            INSTANTS()
            return answer

        return call

    def statement(*_: object) -> None:
        INSTANTS()

    from twin.changesets import undo

    events = ((sa.Engine, "before_cursor_execute"), (sa.Engine, "commit"))
    for target, name in events:
        sa.event.listen(target, name, statement)
    try:
        with (
            mock.patch.object(NvdbClient, "request", around(NvdbClient.request)),
            mock.patch.object(undo, "replace_file", around(undo.replace_file)),
        ):
            yield
    finally:
        for target, name in events:
            sa.event.remove(target, name, statement)


class History:
    """One history: a store, its folders, NVDB, and what the model knows."""

    def __init__(self, stack: ExitStack, base: Path, folder: Path, seed: int) -> None:
        self.draw = random.Random(seed)
        self.seed = seed
        self.folder = folder
        self.store_path = Path(shutil.copy(base, folder / "twin.db"))
        codes = self.draw.choice([(), (), ("BEHANDLES",)])
        skriv = stack.enter_context(SkrivReplayServer(world_of(base), users={USER: SECRET}, on_the_way=codes))
        raws = without_poles(base)
        world = ReplayWorld(
            {kind: [r for r in raws if r["metadata"]["type"]["id"] == kind] for kind in (95, 96)}
        )
        les = stack.enter_context(ReplayServer(world))
        templates = {r["metadata"]["type"]["id"]: r for r in raws if r["id"] in {1042500101, 1042600101}}
        self.country = Country(skriv, les, world, templates)
        self.country.shown = {
            item.nvdb_id: (item.versjon, item.sist_modifisert, item.sluttdato, tuple(item.barn))
            for item in skriv.world.objects.values()
        }
        self.told: list[str] = []
        self.decided: dict[str, str] = {}
        self.is_stale = False
        self.carried_out: list[tuple[str, ...]] = []
        self.done: set[str] = set()
        """Findings that were carried out and that no match has seen the result of."""
        self.written: set[str] = set()
        """Those of them that NVDB's reading side shows."""
        self.read: set[str] = set()
        """Those of them that a sync has read."""
        self._watch(skriv)

    def _watch(self, skriv: SkrivReplayServer) -> None:
        """Look at each set at the moment in which it is carried out."""
        carry_out = skriv.world.carry_out

        def watched(sett: Endringssett) -> dict[int, tuple[int, int]]:
            self._check_set(sett)
            return carry_out(sett)

        skriv.world.carry_out = watched  # type: ignore[method-assign]

    def _check_set(self, sett: Endringssett) -> None:
        """No finding twice, none that is not accepted, none of an older match."""
        named = [key for group in groups_in(sett) for key in group.change_ids]
        self.carried_out.append(tuple(named))
        if not named:
            # An undo set: what it removes and turns back may be done again.
            self.done.clear()
            return
        if self.is_stale:
            self.told.append(f"{named} was started though NVDB was read anew and not matched")
        accepted = set(self.with_decision(Decision.ACCEPT))
        for key in named:
            if key in self.done:
                self.told.append(f"{key} was carried out twice")
            if key not in accepted:
                self.told.append(f"{key} was carried out and is not accepted")
            self.done.add(key)
            self.written.discard(key)
            self.read.discard(key)

    def with_decision(self, decision: str | None = None, *, only_new: bool = False) -> list[str]:
        """Findings of the last match that ask for a decision, with this one."""
        with Store.open(self.store_path) as store:
            change, said = schema.change.c, schema.decision.c
            decided = sa.func.coalesce(said.decision, Decision.OPEN).label("decision")
            rows = store.rows(
                sa.select(change.change_id, change.verdict, decided)
                .select_from(schema.change.outerjoin(schema.decision, said.change_id == change.change_id))
                .order_by(change.change_id)
            )
        return [
            row["change_id"]
            for row in rows
            if row["verdict"] not in {*QUIET, Verdict.REVIEW}
            and decision in {None, row["decision"]}
            and (row["verdict"] == Verdict.NEW or not only_new)
        ]

    # -- steps ---------------------------------------------------------------------------------------------

    def step(self) -> str:
        """Do something, and say what."""
        weights = {
            self.submit: 12, self.export: 6, self.decide: 4, self.sync: 2, self.match: 3,
            self.copy: 3, self.undo: 1, self.lag: 1,
        }  # fmt: skip
        action = self.draw.choices(list(weights), list(weights.values()))[0]
        with suppress(TwinError, NvdbError):
            return action()
        return f"{action.__name__}: refused"

    def decide(self) -> str:
        """Decide about some findings."""
        # NVDB guards what it has by its versions: new signs are what can be there twice.
        keys = self.with_decision(only_new=self.draw.random() < 0.5)
        chosen = [key for key in keys if self.draw.random() < 0.5]
        said = self.draw.choice(
            [Decision.ACCEPT, Decision.ACCEPT, Decision.ACCEPT, Decision.DISMISS, Decision.DEFER]
        )
        with Store.open(self.store_path) as store:
            decide(store, chosen, said, by="kari")
        self.decided |= dict.fromkeys(chosen, said)
        return f"{said} {chosen}"

    def export(self) -> str:
        """Export, but for the GeoPackages, which no set depends on."""
        name = self.draw.choice(FOLDERS)
        self.export_to(self.folder / name)
        return f"export {name}"

    def export_to(self, out: Path) -> int:
        """Write the change sets of a folder; how many findings they hold."""
        with Store.open(self.store_path) as store:
            store.matched()
            refuse_if_pending(store, out)
            made = groups_from_store(store, log=SentLog(store, self.country.skriv.url))
            if self.is_stale:
                self.told.append("findings were exported though NVDB was read anew and not matched")
        if wrong := made.findings.keys() - set(self.with_decision(Decision.ACCEPT)):
            self.told.append(f"{sorted(wrong)} were exported and are not accepted")
        out.mkdir(exist_ok=True)
        for path in out.iterdir():
            if is_change_set_file(path.name):
                path.unlink()
        for name, content in files_of(made).items():
            (out / name).write_bytes(content)
        return sum(len(group.change_ids) for sett in made.setts for group in sett.groups)

    def copy(self) -> str:
        """Copy a folder, without and with what stands beside its sets, or one set out of it."""
        source, to = self.draw.sample(FOLDERS, 2)
        if not (self.folder / source).exists():
            return "copy: nothing there"
        if self.draw.random() < 0.3:
            sets = sorted((self.folder / source).glob("endringssett-?.xml"))
            if sets:
                shutil.copy(self.draw.choice(sets), self.folder / "lone.xml")
            return f"copy one set of {source}"
        shutil.rmtree(self.folder / to, ignore_errors=True)
        shutil.copytree(self.folder / source, self.folder / to)
        return f"copy {source} to {to}"

    def submit(self) -> str:
        """Send a folder or a lone set: alone, two at once, killed, answers lost, from two stores."""
        names = [name for name in (*FOLDERS, "lone.xml") if (self.folder / name).exists()]
        if not names:
            return "submit: nothing there"
        path = self.folder / self.draw.choice(names)
        how = self.draw.choice(["alone", "alone", "twice", "killed", "killed", "lost", "copied"])
        copied = self.folder / "copied.db"
        if how == "copied":
            shutil.copy(self.store_path, copied)
        if how == "twice":
            threads = [threading.Thread(target=self.send, args=(path,)) for _ in range(2)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        elif how == "killed" or (how == "copied" and self.draw.random() < 0.5):
            with suppress(KilledError), INSTANTS.armed(self.draw.randrange(MOST_INSTANTS)):
                self.send(path)
        else:
            if how == "lost":
                ends = ["POST /rest/v3/endringssett", "/start", "/status"]
                self.country.skriv.lose.append(self.draw.choice(ends))
            self.send(path)
            self.country.skriv.lose.clear()
        if how == "copied":
            self.send(path, copied)
        return f"submit {path.name}, {how}"

    def send(self, path: Path, store_path: Path | None = None) -> int:
        """Run ``twin submit --go``; how many sets were accepted, -1 where it was refused."""
        server = self.country.skriv
        with (
            suppress(TwinError, NvdbError),
            Store.open(store_path or self.store_path) as store,
            NvdbClient(server.url, sleep=lambda _s: None) as http,
        ):
            client = SkrivClient(http, OidcLogin(http, lambda: (USER, SECRET)), sleep=lambda _s: None)
            url = server.url + self.draw.choice(["", "/", "//"])
            done = submit(path, store, client, api_url=url, timeout_s=60, say=lambda _: None)
            return sum(item.accepted for item in done)
        return -1

    def undo(self) -> str:
        """Send a set that undoes another."""
        found = sorted(self.folder.glob("*/endringssett-*-angre-*.xml"))
        if not found:
            return "undo: nothing there"
        path = self.draw.choice(found)
        return f"undo {path.name}: {self.send(path)}"

    def sync(self) -> str:
        """Read NVDB when the reading side has caught up."""
        self.country.catch_up()
        self.written |= self.done
        return self.lag()

    def lag(self) -> str:
        """Read NVDB as the reading side has it."""
        with Store.open(self.store_path) as store:
            before = store.revision()
            sync_nvdb(store, AREA, api_url=self.country.les.url, confirm_deletions=True)
            self.is_stale |= store.revision() != before
        self.read |= self.written
        return "sync"

    def match(self) -> str:
        """Match: what the mirror shows by now is no finding, or another one than was carried out."""
        with Store.open(self.store_path) as store:
            match(store)
        self.is_stale = False
        self.done -= self.read
        return "match"

    # -- what must hold ------------------------------------------------------------------------------------

    def check(self) -> list[str]:
        """Everything that is wrong by now."""
        poles = self.country.poles()
        twins = [one for i, one in enumerate(poles) for other in poles[:i] if math.dist(one, other) < 1.0]
        told = [f"two poles stand at {one}" for one in twins]
        with Store.open(self.store_path) as store:
            log = store.rows(
                sa.select(schema.decision_log.c.change_id, schema.decision_log.c.decision)
                .where(schema.decision_log.c.kind == "decided")
                .order_by(schema.decision_log.c.id)
            )
        last = {row["change_id"]: row["decision"] for row in log}
        lost = [key for key, said in self.decided.items() if last.get(key, "open") != said]
        return [*self.told, *told, *(f"the decision about {key} is lost" for key in lost)]

    def end(self) -> list[str]:
        """Let everything settle: what is accepted gets to NVDB, and nothing is left on the way."""
        self.sync()
        self.match()
        self.send(next(self.folder / name for name in FOLDERS if (self.folder / name).exists()))
        with suppress(TwinError):
            self.export_to(self.folder / "end")
        self.send(self.folder / "end")
        self.sync()
        self.match()
        with Store.open(self.store_path) as store:
            open_sets = SentLog(store, self.country.skriv.url).unfinished()
        left = self.export_to(self.folder / "last")
        sets = self.country.skriv._sets
        idle = [set_id for set_id, entry in sets.items() if entry.codes == [IKKE_STARTET]]
        return [
            *self.check(),
            *(f"{set_id} was registered and never started nor cancelled" for set_id in idle),
            *(f"{sent.set_id} is still under way" for sent in open_sets),
            *([f"{left} findings are still to be sent"] if left else []),
        ]


def run_history(base: Path, folder: Path, seed: int) -> tuple[list[str], list[str]]:
    """Run one history; what was done, and what is wrong."""
    steps: list[str] = []
    with ExitStack() as stack:
        stack.enter_context(counted())
        history = History(stack, base, folder, seed)
        steps += [history.decide(), history.export()]
        for _ in range(STEPS):
            steps.append(history.step())
            if wrong := history.check():
                return steps, wrong
        return steps, history.end()


def story(seed: int, steps: list[str], wrong: list[str]) -> str:
    """Tell a history that went wrong."""
    return json.dumps({"seed": seed, "steps": steps, "wrong": wrong}, indent=1)
