"""The page's plain English: what records of the store mean, in words."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence

from twin.decisions.log import CARRIED, OPINION, REOPENED, UNDONE, WITHDRAWN, Entry
from twin.store.kinds import Decision, Verdict

VERDICTS: Mapping[str, str] = {
    Verdict.UNCHANGED: "As in NVDB",
    Verdict.MOVED: "Moved",
    Verdict.WRONG_TYPE: "Another sign than in NVDB",
    Verdict.NEW: "Not in NVDB",
    Verdict.MISSING: "Gone",
    Verdict.NOT_OBSERVABLE: "Could not be seen",
    Verdict.REVIEW: "Unsure",
}
TERMS: Mapping[str, tuple[str, str]] = {
    "position": ("Position", "How well the two positions fit together; above 0 speaks for the pair."),
    "code": ("Sign code", "How well the codes on the plates fit together."),
    "text": ("Text", "How well the texts on the plates fit together."),
    "facing": ("Facing", "Whether the plate looks at a camera that saw it."),
    "side": ("Side of the road", "Whether it stands on the side that NVDB says."),
    "presence": ("In view", "Whether a sign that stands there would have been seen."),
}
_DONE = {
    Decision.ACCEPT: "accepted it",
    Decision.DISMISS: "dismissed it",
    Decision.DEFER: "put it off",
    Decision.OPEN: "opened it again",
}
READ_ONLY = "This page is for looking only: nothing can be answered here."
ASK_NAME = "Say who you are first: every answer is kept with a name."


def entry_sentence(entry: Entry) -> str:
    """Tell one entry of the log."""
    why = f": {entry.reason}" if entry.reason else "."
    done = _DONE[entry.decision]
    return {
        UNDONE: f"{entry.by} took an answer back.",
        WITHDRAWN: f"{entry.by} took an answer back.",
        REOPENED: f"twin opened it again: {entry.reason}",
        CARRIED: f"The decision of {entry.by} holds again{why}",
        OPINION: f"{entry.by} would have {done}{why}",
    }.get(entry.kind, f"{entry.by} {done}{why}")


def seen_sentence(drives: int, cameras: Sequence[str], first_ns: int | None, last_ns: int | None) -> str:
    """Tell when it was seen, and by how many cameras: "Seen 12 June 2026 by two cameras"."""
    if first_ns is None or last_ns is None:
        return f"Not seen by {counted(drives, 'drive')} that had its place in view."
    first, last = day(first_ns), day(last_ns)
    when = first if first == last else f"{first} to {last}"
    more = f" on {counted(drives, 'drive')}" if drives > 1 else ""
    return f"Seen {when} by {counted(len(cameras), 'camera')}{more}."


def sigma_sentence(major95_m: float) -> str:
    """Tell how well a position is known."""
    size = f"{100 * major95_m:.0f} cm" if major95_m < 1 else f"{major95_m:.1f} m"
    return f"Known to {size}: the sign stands within the ellipse with 95 % probability."


def day(epoch_ns: int) -> str:
    """12 June 2026, UTC."""
    at = dt.datetime.fromtimestamp(epoch_ns / 1e9, tz=dt.UTC)
    return f"{at.day} {at:%B %Y}"


_NUMBERS = ("no", "one", "two", "three", "four", "five", "six")


def counted(n: int, what: str) -> str:
    """One drive, two drives, 12 drives."""
    number = _NUMBERS[n] if n < len(_NUMBERS) else f"{n:,}"
    return f"{number} {what}" if n == 1 else f"{number} {what}s"
