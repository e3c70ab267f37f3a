"""Findings of drives that do not fit themselves are for review."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from twin.matching.change import Change, change_id

_CLAIMS = ("new", "moved", "wrong_type", "missing")


def doubt_of(name: str, misfits: Sequence[str]) -> str:
    """Return the sentence that says in which way a drive does not fit itself; "" where it does."""
    if not misfits:
        return ""
    return f"The drive {name} does not fit itself ({'; '.join(misfits)}): mend it and ingest it again."


def doubtful_as_review(changes: Sequence[Change], doubts: Mapping[str, str]) -> list[Change]:
    """Turn what contradicts NVDB into ``review`` where it rests on a drive whose positions are not trusted.

    Parameters
    ----------
    doubts : mapping of drive id to the sentence of `doubt_of`
        Of the drives that are not trusted alone.
    """

    def judged(change: Change) -> Change:
        doubt = next((doubts[one] for one in change.drive_ids.split(",") if one in doubts), "")
        if not doubt or change.verdict not in _CLAIMS:
            return change
        return replace(
            change,
            # An id of its own: the same site may have another review.
            change_id=change_id("review", change.change_id),
            verdict="review",
            reason=f"{doubt} Else this would be {change.verdict.replace('_', ' ')}: {change.reason}",
        )

    return sorted(map(judged, changes), key=lambda change: change.change_id)
