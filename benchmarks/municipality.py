"""Verdicts on a simulated municipality: who is right, how often, and whether the confidences are true.

Usage: python benchmarks/municipality.py [--seeds 5] [--signs 5000] [--drives 40] [--overlooked 0.002]
       [--centre-line 0.0] [--misread 0.0] [--exchanged 0.0]

A grid of roads, poles beside it with up to five plates, some in clusters 0.8 m apart; NVDB's positions with
0.3 m of noise; 2 % each moved by 0.5 to 10 m, with another code on a plate, unknown to NVDB, and gone;
0.5 % taken down between two drives.
Drives wander over the grid with the simulated car's cameras; what its front was in view of is annotated, but
for a few overlooked; positions are drawn from their covariances, half of each variance common to the drive.

Beside it "greedy": the nearest pairs first within the gate, one-to-one, as OSM Conflator matches; the same
code then gives the verdicts. Nothing is timed here: see benchmarks/matching.py.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from municipality_world import World, drive_around, make_world, on_the_centre_line, past_poles, sites_of
from rich.progress import track

from geoloc.arrays import FloatArray, IntArray
from twin.cli.output import console, print_table
from twin.matching.absence import Absence, evidence_of_absence, still_seen
from twin.matching.assign import Assignment, assign
from twin.matching.config import MatchConfig
from twin.matching.likelihood import TERMS, gated_pairs
from twin.matching.poles.poles import ObservedPole, observed_poles
from twin.matching.sites import Site
from twin.matching.verdicts.judge import judge
from twin.store.records import Finding
from twin.words.reasons import NoOwnPosition

BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.0001)


def greedy(poles: Sequence[ObservedPole], sites: Sequence[Site], config: MatchConfig) -> Assignment:
    """The nearest pairs within the gate first, one-to-one, whatever their codes and uncertainties."""
    pairs = gated_pairs(poles, sites, np.ones(len(sites)), config)
    there = np.array([(p.east_m, p.north_m) for p in poles])[pairs.pole]
    known = np.array([(s.east_m, s.north_m) for s in sites])[pairs.site]
    site_of = np.full(len(poles), -1, dtype=np.int64)
    used: set[int] = set()
    for k in np.argsort(np.hypot(*(there - known).T), kind="stable").tolist():
        i, j = int(pairs.pole[k]), int(pairs.site[k])
        if site_of[i] < 0 and j not in used:
            site_of[i] = j
            used.add(j)
    return Assignment(
        site_of_pole=site_of,
        confidence_of_pole=np.ones(len(poles)),
        confidence_of_site=np.ones(len(sites)),
        rival_of_pole=np.full(len(poles), -1, dtype=np.int64),
        terms_of_pole=np.zeros((len(poles), len(TERMS))),
        alternatives_of_pole={},
        alternatives_of_site={},
        together=pairs,
        gated=pairs,
    )


@dataclass(frozen=True, slots=True)
class Judged:
    """One finding beside the truth. `target` is what it should have found, "" if nothing of the kind."""

    verdict: str
    confidence: float
    right: bool
    wrong_pair: bool


@dataclass(slots=True)
class Score:
    """Counts over seeds."""

    right: Counter[str]
    found: Counter[str]
    hit: Counter[str]
    there: Counter[str]
    judged: list[Judged]
    n_signs: int = 0
    n_loose: int = 0
    n_placed: int = 0
    n_placed_right: int = 0


def add_score(
    score: Score,
    world: World,
    sites: Sequence[Site],
    rows: IntArray,
    poles: Sequence[ObservedPole],
    evidence: Absence,
    changes: Sequence[Finding],
) -> None:
    """Compare findings with the truth."""
    config = MatchConfig()
    row_of_place = {(p.east_m, p.north_m): _row(p) for p in poles}
    row_of_site = {k + 1: k for k in rows.tolist()}
    hits: set[tuple[str, int]] = set()
    loose = {site.nvdb_id - 1 for site in sites if not site.own_geometry}
    for change in changes:
        site = change.nvdb_id
        if change.nvdb_type == 96 and site is not None:
            site = (site - 100_000) // 10 + 1
        truth = row_of_site[site] if site is not None else -1
        pole = row_of_place.get((change.east_m, change.north_m), -1)
        name = change.verdict
        paired = pole == truth and pole >= 0
        if name == "review" and truth in loose and isinstance(change.why, NoOwnPosition):
            score.n_placed += 1
            score.n_placed_right += paired
            continue
        if name == "unchanged":
            right = paired and world.edit[truth] in {"", "moved"} and world.off_m[truth] <= config.tolerance_m
        elif name == "moved":
            right = paired and world.off_m[truth] > config.tolerance_m
        elif name == "wrong_type":
            right = paired and world.edit[truth] in {name, "exchanged"}
            right = right and set(change.skiltnummer_seen) <= set(world.codes[truth]) - set(
                world.nvdb_codes[truth]
            )
        elif name == "new":
            right = change.nvdb_type == 95 and world.edit[pole] == name
        else:
            right = change.nvdb_type == 95 and not world.stands[truth]
        if right:
            kind = str(world.edit[truth]) if world.edit[truth] in {"taken_down", "exchanged"} else name
            hits.add((kind, pole if name == "new" else truth))
        wrong_pair = name == "unchanged" and not paired
        score.judged.append(Judged(name, change.confidence, bool(right), wrong_pair))
        score.found[name] += 1
        score.right[name] += bool(right)
    observed = set(row_of_place.values())
    watched = {int(rows[j]) for j in np.flatnonzero(evidence.p_unannotated <= 2 * config.p_missed)}
    off = world.off_m
    wanted = {
        "moved": {k for k in observed - loose if world.known[k] and off[k] >= 2.0},
        "wrong_type": {k for k in observed if world.edit[k] == "wrong_type"},
        "new": {k for k in observed if world.edit[k] == "new"},
        "missing": {k for k in watched - loose if world.edit[k] == "missing"},
        "taken_down": {k for k in watched - loose if world.edit[k] == "taken_down"},
        "exchanged": {k for k in observed if world.edit[k] == "exchanged"},
    }
    for kind, those in wanted.items():
        score.there[kind] += len(those)
        score.hit[kind] += sum((kind, k) in hits for k in those)
    score.n_loose += len(observed & loose)
    score.n_signs += len(world.place)


def _row(pole: ObservedPole) -> int:
    """The world's pole that an observed pole is of; -1 if it was put together from several."""
    rows = {int(member.split(":")[1]) for member in pole.members}
    return rows.pop() if len(rows) == 1 else -1


def print_score(title: str, score: Score) -> None:
    """Recall and precision, reviews, wrong pairs."""
    table = []
    for name in ("new", "wrong_type", "moved", "missing"):
        recall = score.hit[name] / max(score.there[name], 1)
        precision = score.right[name] / max(score.found[name], 1)
        label = "moved (recall: by 2 m or more)" if name == "moved" else name
        table.append([label, score.there[name], f"{recall:.1%}", score.found[name], f"{precision:.1%}"])
    print_table(title, ["finding", "there", "recall", "found", "precision"], table, right_from=1)
    console().print(
        f"taken down between two drives, and passed since: {score.there['taken_down']}, "
        f"of them found missing: {score.hit['taken_down']}"
    )
    if score.there["exchanged"]:
        console().print(
            f"a plate exchanged between two drives, and seen since: {score.there['exchanged']}, "
            f"of them found wrong_type: {score.hit['exchanged']}"
        )
    if score.n_loose:
        console().print(
            f"on the centre line and observed: {score.n_loose:,}, given a position: {score.n_placed:,}, "
            f"of these the right one: {score.n_placed_right / max(score.n_placed, 1):.1%}"
        )
    wrong = sum(one.wrong_pair for one in score.judged)
    unchanged = score.found["unchanged"]
    console().print(
        f"wrong pairs among {unchanged:,} unchanged: {wrong} ({wrong / max(unchanged, 1):.2%}); "
        f"review: {score.found['review']} ({score.found['review'] / score.n_signs:.2%} of the signs); "
        f"not observable: {score.found['not_observable']}"
    )


def print_calibration(score: Score) -> None:
    """Of those given a confidence, how many are right: number, mean of what was said, and what was right.

    The expected calibration error is the mean of |said - right| over the bins, weighted by their numbers.
    """
    groups = {
        "unchanged": ("unchanged",),
        "moved": ("moved",),
        "wrong type": ("wrong_type",),
        "new": ("new",),
        "missing": ("missing",),
        "all": ("unchanged", "moved", "wrong_type", "new", "missing"),
    }
    columns = {name: _calibration([j for j in score.judged if j.verdict in v]) for name, v in groups.items()}
    table: list[list[object]] = []
    for k, (low, high) in enumerate(pairwise(BINS)):
        cells = [
            f"{n[k]:,}: {said[k]:.1%}, {right[k]:.1%}" if n[k] else "–" for n, said, right in columns.values()
        ]
        table.append([f"{low:g} to {min(high, 1.0):g}", *cells])
    errors = []
    for n, said, right in columns.values():
        gap = np.abs(np.nan_to_num(said - right))
        errors.append(f"{float((n * gap).sum() / max(n.sum(), 1)):.2%}")
    table.append(["expected error", *errors])
    print_table("Calibration: number, said, right", ["confidence", *columns], table, right_from=1)


def _calibration(judged: Sequence[Judged]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Number of findings in each bin, their mean confidence, and the share that is right."""
    said = np.array([j.confidence for j in judged])
    right = np.array([j.right for j in judged], dtype=np.float64)
    each = np.digitize(said, BINS[1:-1])
    n = np.bincount(each, minlength=len(BINS) - 1)
    some = np.where(n > 0, n, np.nan)
    mean, share = (np.bincount(each, values, minlength=len(BINS) - 1) / some for values in (said, right))
    return n, mean, share


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--signs", type=int, default=5000)
    parser.add_argument("--drives", type=int, default=40)
    parser.add_argument("--centre-line", type=float, default=0.0, help="share without own geometry")
    parser.add_argument("--overlooked", type=float, default=MatchConfig().p_missed)
    parser.add_argument("--misread", type=float, default=0.0, help="chance that a drive misreads a plate")
    parser.add_argument("--exchanged", type=float, default=0.0, help="share exchanged between two drives")
    options = parser.parse_args()
    ours, theirs = (Score(Counter(), Counter(), Counter(), Counter(), []) for _ in range(2))
    config = MatchConfig()
    for seed in track(range(options.seeds), "municipalities", console=console()):
        rng = np.random.default_rng(seed)
        world = make_world(options.signs, rng, options.exchanged)
        sites, rows = sites_of(world)
        if options.centre_line:
            sites = on_the_centre_line(sites, options.centre_line, rng)
        fleet = drive_around(world, sites, options.drives, options.overlooked, rng, options.misread)
        poles = observed_poles(fleet.estimates, fleet.order, config, fleet.seen_from_deg)
        poles = still_seen(poles, past_poles(fleet, poles), config)
        evidence = evidence_of_absence(fleet.passages, sites, config)
        p_unannotated = evidence.p_unannotated
        for score, assignment in (
            (ours, assign(poles, sites, p_unannotated, config)),
            (theirs, greedy(poles, sites, config)),
        ):
            changes = judge(
                poles,
                sites,
                assignment,
                evidence.complete,
                evidence.watched_by,
                config,
                p_unannotated=p_unannotated,
                passed=evidence.passed,
            )
            add_score(score, world, sites, rows, poles, evidence, changes)
    print_score(f"twin, {ours.n_signs:,} signs", ours)
    print_score("greedy: nearest first within the gate", theirs)
    print_calibration(ours)


if __name__ == "__main__":
    main()
