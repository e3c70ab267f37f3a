"""Random histories of annotating anew, deciding, undoing, syncing and matching, against a model.

Two drives past eighteen poles that NVDB does not know, two of them 1.5 m apart, one with two signs annotated
one by one. Each ingest may number the objects anew, click otherwise, leave some out, or find another
calibration, which moves everything. The model knows which pole every id means.
"""

from __future__ import annotations

import json
import random
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from twin.decisions import decide, undo
from twin.decisions.evidence import Evidence, differences, present_evidence
from twin.errors import RefusedError, TwinError
from twin.matching import match
from twin.store import schema
from twin.store.kinds import Decision
from twin.store.store import Row, Store

DRIVES = ("a4fa72eb80eb", "second")
METHOD = "adjusted"
FAR_SITES = (1042500116, 1042500117, 1042500118, 1042500119, 1042500120)
STEPS = 12
DAY_NS = 86_400_000_000_000
CLICK_M = 0.02
"""How far other clicks move a pole: few leave an ellipse by it, and none comes near its neighbour."""


@dataclass
class Seen:
    """One object of one drive, as its annotators see it now; `pole` is the truth."""

    pole: str
    estimate: Row
    sightings: list[Row]
    clicks: int = 0
    """How often it was clicked anew."""
    jitter_m: tuple[float, float] = (0.0, 0.0)
    is_out: bool = False


@dataclass
class Model:
    """What people said: commands, each the poles that it decided and what was known of them."""

    commands: list[dict[str, tuple[str, Evidence]]] = field(default_factory=list)

    def holds(self, pole: str, now: Evidence) -> str:
        """The decision that must hold of a pole."""
        said = next((one[pole] for one in reversed(self.commands) if pole in one), None)
        return Decision.OPEN if said is None or differences(said[1], now) else said[0]


def unknown_poles(base: Path, path: Path) -> None:
    """Make the store: NVDB's signs near the road are gone, and a second drive has passed."""
    path.write_bytes(base.read_bytes())
    with Store.open(path) as store, store.transaction() as connection:
        for table in (schema.skiltpunkt, schema.skiltplate):
            connection.execute(sa.delete(table).where(table.c.nvdb_id.not_in(FAR_SITES)))
        connection.execute(sa.update(schema.drive).values(annotations_complete=False))
        for table in (schema.drive, schema.drive_method):
            rows = [dict(row) for row in connection.execute(sa.select(table)).mappings()]
            later = {"drive_id": DRIVES[1], "name": "second"}
            for row in rows:
                row |= {name: later[name] for name in later if name in row}
                if "started_ns" in row:
                    row |= {name: row[name] + DAY_NS for name in ("started_ns", "ended_ns")}
            connection.execute(sa.insert(table), rows)


class History:
    """One history: a store, and what is true of it."""

    def __init__(self, store: Store, seed: int) -> None:
        self.store = store
        self.draw = random.Random(seed)
        self.model = Model()
        self.shift_m = dict.fromkeys(DRIVES, (0.0, 0.0))
        self.pole_of: dict[str, str] = {}
        self.is_stale = True
        objects = self._objects()
        self.seen = {drive: self._of_drive(objects, drive) for drive in DRIVES}
        for drive in DRIVES:
            self._ingest(drive, renumber=False)
        self.match()

    def _objects(self) -> list[Seen]:
        rows = self.store.rows(sa.select(schema.estimate).where(schema.estimate.c.method == METHOD))
        sightings = self.store.rows(sa.select(schema.sighting).where(schema.sighting.c.method == METHOD))
        made = [
            Seen(row["object"], row, [s for s in sightings if s["object"] == row["object"]]) for row in rows
        ]
        by_name = {one.pole: one for one in made}
        # A pole of the same codes beside P09, a second sign on P12, and another sign 1.5 m behind P14.
        near = [("P09", "P09b", 1.5, None), ("P12", "P12", 0.05, "808"), ("P14", "P14b", -1.5, "512")]
        for name, pole, east_m, code in near:
            one = by_name[name]
            row = {**one.estimate, "east_m": one.estimate["east_m"] + east_m}
            row |= {"cov_ee_m2": 1.1 * row["cov_ee_m2"], "skiltnummer": code or row["skiltnummer"]}
            moved = [{**s, "u_px": s["u_px"] + 40.0} for s in one.sightings]
            made.append(Seen(pole, row, moved))
        return made

    def _of_drive(self, objects: list[Seen], drive: str) -> list[Seen]:
        later = DAY_NS if drive == DRIVES[1] else 0
        ns = ("first_ns", "last_ns")
        made = []
        for one in objects:
            estimate = {**one.estimate, **{name: one.estimate[name] + later for name in ns}}
            made.append(Seen(one.pole, estimate, one.sightings))
            if later:
                self._click(made[-1])
        return made

    def _click(self, one: Seen) -> None:
        one.clicks += 1
        one.jitter_m = (self.draw.gauss(0, CLICK_M), self.draw.gauss(0, CLICK_M))

    # -- steps ---------------------------------------------------------------------------------------------

    def step(self) -> str:
        """Do something, and say what."""
        weights = {self.annotate: 5, self.match: 5, self.decide: 5, self.undo: 1, self.calibrate: 2}
        weights[self.sync] = 1
        return self.draw.choices(list(weights), list(weights.values()))[0]()

    def annotate(self) -> str:
        """Number the objects of a drive anew, click some otherwise, leave some out."""
        drive = self.draw.choice(DRIVES)
        for one in self.seen[drive]:
            one.is_out = self.draw.random() < 0.15
            if self.draw.random() < 0.3:
                self._click(one)
        return f"annotate {drive}: {self._ingest(drive, renumber=True)}"

    def calibrate(self) -> str:
        """Move all that a drive saw, the clicks being the same: by its clock, its datum, its antenna."""
        drive = self.draw.choice(DRIVES)
        # By as much as two poles are apart, too: one then stands where the other one stood.
        anywhere = (self.draw.uniform(-4, 4), self.draw.uniform(-4, 4))
        self.shift_m = dict.fromkeys(
            DRIVES, self.draw.choice([(0.0, 0.0), (1.5, 0.0), (-1.5, 0.0), anywhere])
        )
        for one in DRIVES:
            self._ingest(one, renumber=one == drive)
        return f"calibrate by {self.shift_m[drive]}"

    def _ingest(self, drive: str, *, renumber: bool) -> str:
        seen = [one for one in self.seen[drive] if not one.is_out]
        names = [f"P{k + 1:02d}" for k in range(len(self.seen[drive]) + 2)]
        how = self.draw.choice(["in order", "reversed", "any", "renamed"]) if renumber else "in order"
        if how == "reversed":
            names.reverse()
        elif how == "any":
            self.draw.shuffle(names)
        elif how == "renamed":
            names = [f"skilt {self.draw.random()}" for _ in names]
        estimates, sightings = [], []
        for name, one in zip(names, seen, strict=False):
            self.pole_of[f"{drive}:{name}"] = one.pole
            row = {**one.estimate, "drive_id": drive, "object": name, "estimate_id": f"{drive}:{name}"}
            for axis, k in (("east_m", 0), ("north_m", 1)):
                row[axis] += one.jitter_m[k] + self.shift_m[drive][k]
            estimates.append(row)
            for old in one.sightings:
                number, v_px = len(sightings), old["v_px"] + 0.25 * one.clicks
                new = {**old, "drive_id": drive, "object": name, "number": number, "v_px": v_px}
                sightings.append(new)
        with self.store.transaction() as connection:
            for table, rows in ((schema.estimate, estimates), (schema.sighting, sightings)):
                where = (table.c.drive_id == drive, table.c.method == METHOD)
                connection.execute(sa.delete(table).where(*where))
                connection.execute(sa.insert(table), rows)
            self.store.touch(connection)
        self.is_stale = True
        return f"{how}, without {sorted({one.pole for one in self.seen[drive] if one.is_out})}"

    def sync(self) -> str:
        """NVDB has a new version of a sign elsewhere."""
        point = schema.skiltpunkt
        with self.store.transaction() as connection:
            connection.execute(sa.update(point).values(version=point.c.version + 1))
            self.store.touch(connection)
        self.is_stale = True
        return "sync"

    def match(self) -> str:
        """Match."""
        match(self.store, method=METHOD)
        self.is_stale = False
        return "match"

    def decide(self) -> str:
        """Decide about some findings, or see that stale ones are refused."""
        said = self.draw.choice([Decision.DISMISS, Decision.DISMISS, Decision.ACCEPT, Decision.DEFER])
        known = self.findings()
        chosen = [key for key in sorted(known) if self.draw.random() < 0.4]
        try:
            done = decide(self.store, chosen, said, by="kari")
        except RefusedError:
            return "decide: refused" if self.is_stale else "decide: refused though nothing is stale"
        if done.change_ids:
            self.model.commands.append({known[key][0]: (said, known[key][1]) for key in done.change_ids})
        return f"{said} {sorted(known[key][0] for key in done.change_ids)}"

    def undo(self) -> str:
        """Take the last command back."""
        try:
            undo(self.store, by="kari")
        except TwinError:
            return "undo: refused"
        self.model.commands.pop()
        return "undo"

    # -- what must hold ------------------------------------------------------------------------------------

    def findings(self) -> dict[str, tuple[str, Evidence]]:
        """Each new sign of the last match: its pole in truth, and what is known of it."""
        keys = self.store.rows(sa.select(schema.pole_key))
        of_key: dict[str, set[str]] = {}
        for row in keys:
            of_key.setdefault(row["pole"], set()).add(self.truth_at_match[row["member"]])
        evidence = present_evidence(self.store.rows)
        new = {key: one for key, one in evidence.items() if one.nvdb_type == 95 and one.nvdb_id is None}
        return {key: ("+".join(sorted(of_key[one.pole])), one) for key, one in new.items()}

    @property
    def truth_at_match(self) -> dict[str, str]:
        """Pole of each member of the last match."""
        if not self.is_stale:
            self._truth = dict(self.pole_of)
        return self._truth

    def check(self) -> list[str]:
        """Every pole whose decision is not the one that its people made, where the match is of now."""
        if self.is_stale:
            return []
        said = {row["change_id"]: row["decision"] for row in self.store.rows(sa.select(schema.decision))}
        told = []
        for key, (pole, now) in self.findings().items():
            wanted, has = self.model.holds(pole, now), said.get(key, Decision.OPEN)
            if wanted != has:
                told.append(f"{pole} is {has}, and people said {wanted}")
        return told


def run_history(path: Path, seed: int) -> tuple[list[str], list[str]]:
    """Run one history on a copy of the store; what was done, and what is wrong."""
    with Store.open(path) as store:
        history = History(store, seed)
        steps = [history.decide()]
        for _ in range(STEPS):
            steps.append(history.step())
            if wrong := history.check():
                return steps, wrong
        steps.append(history.match())
        return steps, history.check()


def story(seed: int, steps: list[str], wrong: list[str]) -> str:
    """Tell a history that went wrong."""
    told: dict[str, Any] = {"seed": seed, "steps": steps, "wrong": wrong}
    return json.dumps(told, indent=1)
