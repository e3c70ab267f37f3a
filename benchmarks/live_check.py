"""The live check against the match of the same drive, and a region's mirror read along the way.

Usage: OMP_NUM_THREADS=1 python benchmarks/live_check.py [PART ...] [--seeds 3] [--poles 580000] [--markdown]

Parts: `verdicts` (the shipped sample, and simulated drives past signs of which NVDB has some 3 m off and
more, some with another code, some not at all, and some that no longer stand: what the live check says last
of each sign against the findings of `twin match` on the same drive, when it said so first, and how often it
changed its mind), `region` (a mirror of so many poles, from its start along a straight road at 20 m/s).
Bar: nine findings of ten that the match gives are the live check's last word, and it contradicts none of
twenty; the nearest sign in 0.1 ms; memory for a region below 100 MB.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import sqlalchemy as sa
from accuracy import show
from rich.progress import track

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import utm33_from_geographic
from nvdb.area import Area
from nvdb.replay import ReplayServer
from twin.cli.output import console
from twin.drives.drive import Drive
from twin.drives.read import read_drive
from twin.ingest import ingest_drive
from twin.live import Arrival, Frame, LiveEngine, arrivals_of, car_of
from twin.live.check import LiveCheck, MirrorAhead, Standing, Verdict
from twin.matching import MatchConfig, match
from twin.mirror.sync import sync_nvdb
from twin.reports.evaluation import read_truth
from twin.samples.demo import sample_folder
from twin.samples.simulation import TRUTH, simulate
from twin.store import schema
from twin.store.kinds import Verdict as Matched
from twin.store.records import Finding
from twin.store.store import Store


class Case(NamedTuple):
    """A kind of simulated drive; without ids the live check follows objects by itself, the match has them."""

    name: str
    kmh: float
    has_ids: bool = True

    @property
    def label(self) -> str:
        """What the table calls it."""
        return f"{self.name}, {self.kmh:.0f} km/h" + ("" if self.has_ids else ", live without ids")


SAMPLE = Case("the sample", 0.0)
CASES = (
    *(Case("urban", 25.0), Case("highway", 60.0), Case("highway", 80.0)),
    *(Case("urban", 25.0, has_ids=False), Case("highway", 60.0, has_ids=False)),
)
AGREE, CONTRADICT, NEAREST_MS, REGION_MB = 0.90, 0.05, 0.1, 100.0
CONFIG = MatchConfig()
EAST_M, NORTH_M = 200_000.0, 7_000_000.0
_OBJECT = {
    "version": 1,
    "start_date": "2010-01-01",
    "own_geometry": True,
    "kommuner": [5001],
    "stedfesting": [],
    "problems": [],
    "raw": b"",
    "synced_at": "2026-06-10T08:00:00Z",
}
_OTHER_CODE = {"362.50": "362.60", "362.60": "362.50"}
_QUIET = (Standing.EXPECTED, Standing.WITHDRAWN)
_SETTLED = (Matched.UNCHANGED, Matched.MOVED, Matched.NEW, Matched.WRONG_TYPE, Matched.MISSING)


class Sign(NamedTuple):
    """One Skiltpunkt with its plates, as NVDB has it."""

    place_m: FloatArray
    codes: tuple[str, ...]


@dataclass(slots=True)
class Tally:
    """What came of some drives."""

    findings: list[str] = field(default_factory=list)
    same: int = 0
    silent: int = 0
    other: list[str] = field(default_factory=list)
    more: list[str] = field(default_factory=list)
    after_s: list[float] = field(default_factory=list)
    before_m: list[float] = field(default_factory=list)
    changes: int = 0
    signs: int = 0
    check_s: float = 0.0
    drive_s: float = 0.0


def nvdb_of(drive: Drive, folder: Path, rng: np.random.Generator) -> list[Sign]:
    """NVDB's signs along a simulated road: most as they stand, some not."""
    places = {one.object: np.array([one.east_m, one.north_m]) for one in read_truth(folder / TRUTH)}
    notes, signs = drive.annotations, list[Sign]()
    codes = dict(zip(notes.object.tolist(), notes.skiltnummer.tolist(), strict=True))
    for name, place in places.items():
        known = place + rng.normal(0.0, 0.1, 2)
        mine = tuple(codes.get(name, "202").split(";"))
        chance = rng.random()
        if chance < 0.1:
            continue
        if chance < 0.2:
            turn = rng.uniform(0.0, 2.0 * np.pi)
            known = place + rng.uniform(2.0, 8.0) * np.array([np.cos(turn), np.sin(turn)])
        elif chance < 0.3:
            mine = (_OTHER_CODE.get(mine[0], "362.60"), *mine[1:])
        signs.append(Sign(known, mine))
        if rng.random() < 0.15:
            signs.append(Sign(place + rng.normal(0.0, 1.0, 2) + rng.choice([-18.0, 18.0], 2), ("516",)))
    return signs


def fill(store: Store, signs: Sequence[Sign]) -> None:
    """Put signs into the mirror."""
    points, plates = [], []
    for number, sign in enumerate(signs, start=1):
        east_m, north_m = sign.place_m.tolist()
        own = {**_OBJECT, "east_m": east_m, "north_m": north_m, "accuracy_cm": 10, "capture_method": "sat"}
        ids = [10 * number + k for k in range(len(sign.codes))]
        points.append({"nvdb_id": number, "plate_ids": ids, **own})
        plates += [
            {"nvdb_id": one, "point_id": number, "skiltnummer": code, **own}
            for one, code in zip(ids, sign.codes, strict=True)
        ]
    with store.transaction() as connection:
        connection.execute(sa.insert(schema.skiltpunkt), points)
        connection.execute(sa.insert(schema.skiltplate), plates)
        store.put_fact(connection, "mirror", {"synced_at": _OBJECT["synced_at"]})


def without_ids(arrival: Arrival) -> Arrival:
    """A frame as a detector gives it, which knows no object again."""
    frame = arrival.what
    if not isinstance(frame, Frame):
        return arrival
    found = tuple(one._replace(object=None) for one in frame.detections)
    return arrival._replace(what=frame._replace(detections=found))


def driven(store: Store, drive: Drive, tally: Tally, *, has_ids: bool) -> list[Verdict]:
    """What the check says of a drive, and the processor's time for it."""
    engine, found = LiveEngine(car_of(drive)), list[Verdict]()
    check = LiveCheck(engine, MirrorAhead(store, CONFIG), is_complete=True)
    for recorded in arrivals_of(drive):
        arrival = recorded if has_ids else without_ids(recorded)
        began = time.process_time()
        estimates = engine.feed(arrival)
        fed = time.process_time()
        found += check.take(arrival, estimates)
        tally.check_s += time.process_time() - fed
        tally.drive_s += time.process_time() - began
    return found + check.finish(engine.finish())


def compare(store: Store, drive: Drive, tally: Tally, *, has_ids: bool = True) -> None:
    """Hold the last word of the check against the findings of a match."""
    ingest_drive(store, drive.path)
    match(store, config=CONFIG)
    findings = [Finding.from_row(row) for row in store.rows(sa.select(schema.change))]
    said, where = driven(store, drive, tally, has_ids=has_ids), _car_at(drive)
    ended = {one.id: one for one in said}
    left = {name: one for name, one in ended.items() if one.standing not in _QUIET}
    for one in findings:
        if one.verdict not in _SETTLED:
            continue
        tally.findings.append(one.verdict.value)
        name = _name(one, left.values())
        live = left.pop(name, None)
        if live is None:
            tally.silent += 1
        elif live.standing.value != one.verdict.value:
            tally.other.append(f"{live.standing.value} for {one.verdict.value}")
        else:
            tally.same += 1
            first = next(say for say in said if (say.id, say.standing) == (name, live.standing))
            if first.first_seen_ns:
                tally.after_s.append((first.at_ns - first.first_seen_ns) / 1e9)
            tally.before_m.append(where(first.at_ns, np.array([live.east_m, live.north_m])))
    tally.more += [one.standing.value for one in left.values()]
    tally.signs += len({one.id for one in said if one.standing is not Standing.EXPECTED})
    tally.changes += sum(one.was not in (None, Standing.EXPECTED, one.standing) for one in said)


def _name(finding: Finding, said: Iterable[Verdict]) -> str:
    """What the check calls it: what NVDB lacks is known by its place."""
    if finding.nvdb_id is not None:
        return f"{finding.nvdb_type}:{finding.nvdb_id}"
    place = np.array([finding.east_m, finding.north_m])
    near = {
        one.id: float(np.hypot(*(place - (one.east_m, one.north_m))))
        for one in said
        if one.nvdb_id is None and ("/" in one.id) == ("site" in finding.terms)
    }
    return min(near, key=lambda name: near[name]) if min(near.values(), default=9.0) < 1.0 else ""


def _car_at(drive: Drive) -> Callable[[int, FloatArray], float]:
    """How far before a place (below 0: behind) the car was at some time, along its way."""
    fixes = drive.gnss[0]
    east, north = utm33_from_geographic(fixes.latitude_deg, fixes.longitude_deg)
    track_m = np.stack([east, north], axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track_m, axis=0).T))])

    def before(at_ns: int, place_m: FloatArray) -> float:
        here = np.interp(at_ns, fixes.host_ns, along)
        beside = along[np.argmin(np.hypot(*(track_m - place_m).T))]
        return float(beside - here)

    return before


def verdicts(seeds: int, *, markdown: bool) -> bool:
    """Print a row a kind of drive; return whether all are within the bars."""
    tallies: dict[str, Tally] = {}
    drives = [(SAMPLE, 0)] + [(case, seed) for case in CASES for seed in range(seeds)]
    for case, seed in track(drives, "drives", console=console(), transient=True):
        tally = tallies.setdefault(case.label if case is not SAMPLE else case.name, Tally())
        with tempfile.TemporaryDirectory() as folder, Store.open(Path(folder) / "twin.db") as store:
            if case is SAMPLE:
                with ReplayServer(sample_folder() / "nvdb") as server:
                    sync_nvdb(store, Area(kommuner=(5001,)), api_url=server.url)
                compare(store, read_drive(sample_folder() / "trip_trondheim"), tally)
                continue
            trip = Path(folder) / "trip"
            simulate(trip, name=case.name, speed_kmh=case.kmh, seed=seed)
            drive = read_drive(trip)
            fill(store, nvdb_of(drive, trip, np.random.default_rng(seed)))
            compare(store, drive, tally, has_ids=case.has_ids)
    rows, good = [], True
    for label, one in tallies.items():
        findings = len(one.findings)
        within = one.same >= AGREE * findings and len(one.other) <= CONTRADICT * findings
        good &= within
        after, before = np.array(one.after_s), np.array(one.before_m)
        rows.append(
            (
                label,
                _counted(one.findings),
                f"{one.same} of {findings}",
                one.silent,
                _counted(one.other),
                _counted(one.more),
                f"{np.median(after):.1f} / {np.quantile(after, 0.95):.1f} s",
                f"{np.median(before):.0f} m",
                f"{one.changes / one.signs:.2f}",
                f"{100 * one.check_s / one.drive_s:.0f}%",
                "yes" if within else "NO",
            )
        )
    header = [
        *("drive", "findings of the match", "the same", "nothing said", "another", "more", "said after"),
        *("before the sign", "changes a sign", "of the time", "within bars"),
    ]
    show("Live verdicts against the match of the same drive", header, rows, markdown=markdown)
    return good


def _counted(some: Sequence[str]) -> str:
    names = sorted(set(some))
    return ", ".join(f"{some.count(name)} {name}" for name in names) or "0"


def region(poles: int, *, markdown: bool) -> bool:
    """Print what a mirror of a region costs; return whether that is within the bars."""
    rng, rows = np.random.default_rng(1), list[tuple[str, str, str]]()
    side_m = 1000.0 * np.sqrt(poles / 15.0)
    with tempfile.TemporaryDirectory() as folder, Store.open(Path(folder) / "region.db") as store:
        for begin in track(range(0, poles, 20_000), "mirror", console=console(), transient=True):
            n = min(20_000, poles - begin)
            _put(store, begin, np.array([EAST_M, NORTH_M]) + rng.uniform(0.0, side_m, (n, 2)))
        before_mb, began = _peak_mb(), time.perf_counter()
        signs = MirrorAhead(store, CONFIG)
        begun_s, waited_s, nearest_s = time.perf_counter() - began, list[float](), list[float]()
        # A straight road through the middle: 20 m/s, looked at twice a second, played ten times as fast.
        for metres in np.arange(0.0, min(side_m, 20_000.0), 10.0):
            place = np.array([EAST_M + metres, NORTH_M + side_m / 2])
            began = time.perf_counter()
            signs.move(place)
            signs.near(place[None], 30.0)
            waited_s.append(time.perf_counter() - began)
            began = time.thread_time()
            signs.is_mirrored(place[None])
            nearest_s.append(time.thread_time() - began)
            time.sleep(0.05)
        signs.close()
        grown_mb = _peak_mb() - before_mb
    nearest_ms = 1000.0 * float(np.median(nearest_s))
    rows += [
        (f"{poles:,} poles: from start", f"{begun_s:.1f} s", ""),
        ("signs near the car: median", f"{1000 * np.median(waited_s):.2f} ms", ""),
        ("longest, at the first square", f"{1000 * max(waited_s[:1]):.0f} ms", ""),
        ("longest, later", f"{1000 * max(waited_s[1:]):.0f} ms", ""),
        ("the nearest sign, of the processor", f"{nearest_ms:.3f} ms", f"{NEAREST_MS}"),
        ("memory", f"+{grown_mb:.0f} MB", f"{REGION_MB:.0f}"),
    ]
    show("A region's mirror along the way", ["", "", "bar"], rows, markdown=markdown)
    return nearest_ms <= NEAREST_MS and grown_mb <= REGION_MB


def _put(store: Store, begin: int, places_m: FloatArray) -> None:
    """Put poles with two plates each into the mirror."""
    points, plates = [], []
    for number, (east_m, north_m) in enumerate(places_m.tolist(), start=begin + 1):
        own = {**_OBJECT, "east_m": east_m, "north_m": north_m, "accuracy_cm": 30, "capture_method": "sat"}
        ids = [10 * number, 10 * number + 1]
        points.append({"nvdb_id": number, "plate_ids": ids, **own})
        plates += [{"nvdb_id": one, "point_id": number, "skiltnummer": "362.50", **own} for one in ids]
    with store.transaction() as connection:
        connection.execute(sa.insert(schema.skiltpunkt), points)
        connection.execute(sa.insert(schema.skiltplate), plates)
        store.put_fact(connection, "mirror", {"synced_at": _OBJECT["synced_at"]})


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Run the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help="verdicts, region (default: both)")
    parser.add_argument("--seeds", type=int, default=3, help="drives a row")
    parser.add_argument("--poles", type=int, default=580_000)
    parser.add_argument("--markdown", action="store_true")
    arguments = parser.parse_args()
    parts = arguments.parts or ["verdicts", "region"]
    if set(parts) - {"verdicts", "region"}:
        parser.error("PART is verdicts or region")
    good = True
    if "verdicts" in parts:
        good &= verdicts(arguments.seeds, markdown=arguments.markdown)
    if "region" in parts:
        good &= region(arguments.poles, markdown=arguments.markdown)
    sys.exit(not good)


if __name__ == "__main__":
    main()
