"""What a store holds as Prometheus reads it: its text format, version 0.0.4."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping

from twin.reports.store_status import Status

Samples = Mapping[str, float]
"""Value of the metric's label → value; "" where the metric has no label of its own."""


def prometheus_text(held: Status) -> str:
    """Return the numbers of a status, each with the label ``store``; what is not known has no line.

    Times are seconds since 1970, as Prometheus compares them with ``time()``. All are gauges: also a count of
    drives falls where a store is restored.
    """
    mirror, match, queue, oldest = held.mirror, held.last_match, held.queue, held.oldest_open
    types = {"skiltpunkt": held.skiltpunkt, "skiltplate": held.skiltplate}
    metrics: list[tuple[str, str, str, Samples]] = [
        ("mirror_objects", "NVDB objects in the mirror.", "type", types),
        ("mirror_synced_timestamp_seconds", "Last sync.", "", _at(mirror.synced_at if mirror else None)),
        ("drives", "Drives in the store.", "", {"": len(held.drives)}),
        ("driven_metres", "Length of these.", "", {"": sum(drive.length_m for drive in held.drives)}),
        ("estimates", "Positions, by geolocation method.", "method", held.estimates),
        ("last_match_timestamp_seconds", "Last match.", "", _at(match.at if match else None)),
        ("findings", "Findings of the last match, by verdict.", "verdict", held.verdicts),
        ("decisions", "Findings that ask for a decision, by what holds.", "decision", held.decisions),
        (
            "oldest_open_finding_timestamp_seconds",
            "First drive of the finding that nobody has decided for the longest.",
            "",
            _at(oldest.since if oldest else None),
        ),
        ("queue_drives", "Drives of the fleet's queue, by state.", "state", queue.jobs),
        ("queue_failing", "Of those that wait or run: failed, and tried again.", "", {"": queue.failing}),
        ("queue_parked", "Drives that wait for a person, by kind of failure.", "kind", queue.parked),
        (
            "queue_oldest_timestamp_seconds",
            "When the drive was put in that waits or runs the longest.",
            "",
            _at(queue.oldest),
        ),
    ]
    lines: list[str] = []
    for name, what, label, samples in metrics:
        if samples:
            lines += [f"# HELP twin_{name} {what}", f"# TYPE twin_{name} gauge"]
        for value, number in samples.items():
            labels = {"store": held.store, label: value} if label else {"store": held.store}
            said = ",".join(f'{key}="{_escaped(text)}"' for key, text in labels.items())
            lines.append(f"twin_{name}{{{said}}} {number}")
    return "".join(f"{line}\n" for line in lines)


def _at(utc: str | None) -> Samples:
    return {"": dt.datetime.fromisoformat(utc).timestamp()} if utc else {}


def _escaped(text: str) -> str:
    """A label's value: a Windows path has backslashes."""
    return text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
