"""A finding to change in a test."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from twin.store.kinds import Verdict
from twin.store.records import Finding
from twin.words.reasons import Told


def finding(change_id: str = "a", **values: Any) -> Finding:
    """Make a finding about a pole that NVDB does not have, with other values where they are given."""
    usual = Finding(
        change_id=change_id,
        verdict=Verdict.NEW,
        why=Told("It stands here."),
        confidence=0.9,
        nvdb_type=95,
        nvdb_id=None,
        nvdb_version=None,
        skiltnummer_nvdb=(),
        skiltnummer_seen=("202",),
        distance_m=None,
        distance_sigma_m=None,
        drive_ids=("d",),
        n_sightings=3,
        east_m=1.0,
        north_m=2.0,
    )
    return replace(usual, **values)
