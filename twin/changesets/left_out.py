"""One sentence on what is not sent, or not exported, because it was sent before."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from twin.changesets.sent import OPEN, SentFinding


def left_out_sentence(held: Sequence[SentFinding], elsewhere: Collection[str] = (), outdated: int = 0) -> str:
    """Count the findings that are left out by their reasons, with the ids of the sets; "" where none is.

    Parameters
    ----------
    held : sequence of SentFinding
        Of this store's own log.
    elsewhere : collection of str
        For each finding that another copy of the store is sending, the id of its set.
    outdated : int
        How many the store would not export as they are.
    """
    done = [one for one in held if one.state not in OPEN]
    under_way = [one for one in held if one.state in OPEN]
    n = len(held) + len(elsewhere) + outdated
    parts = [
        _part(len(done), "carried out before", [one.set_id for one in done]),
        _part(len(under_way), "under way", [one.set_id for one in under_way]),
        _part(len(elsewhere), "under way from another copy of this store", elsewhere),
        _part(outdated, "not accepted in this store as exported: match, decide and export again", ()),
    ]
    told = ", ".join(part for part in parts if part)
    return told and f"{n} finding{'s are' if n > 1 else ' is'} left out ({told})"


def _part(n: int, what: str, set_ids: Collection[str | None]) -> str:
    ids = ", ".join(dict.fromkeys(set_id for set_id in set_ids if set_id))
    return f"{n} {what}{f' in {ids}' if ids else ''}" if n else ""
