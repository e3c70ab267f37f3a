"""When a sign was seen and by whom, first of all; and how well its place is known."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from twin.words.table import Lang, say


class Observed(Protocol):
    """What was seen or looked for: :class:`twin.store.records.Finding`."""

    @property
    def terms(self) -> Mapping[str, Any]:
        """What it rests on, as JSON."""
        ...

    @property
    def cameras(self) -> tuple[str, ...]:
        """That saw it, or looked for it."""
        ...

    @property
    def drive_ids(self) -> tuple[str, ...]:
        """That saw it, or looked for it."""
        ...


def seen_sentence(
    finding: Observed, lang: Lang = Lang.EN, days: Sequence[dt.date] = (), *, alone: bool = True
) -> str:
    """Say when a sign was seen, by how many cameras and drives; of one that was not, who looked for it.

    Parameters
    ----------
    finding : Finding
    days : sequence of date, optional
        Of its drives: when a sign was looked for, which a finding does not know itself.
    alone : bool
        False beside the reason, which tells itself what was not seen, and in how many pictures.

    >>> seen_sentence(finding)  # doctest: +SKIP
    'Seen 12 June 2026 by two cameras.'
    """
    seen = finding.terms.get("seen") or {}
    cameras = say(lang, "seen.cameras", n=len(finding.cameras))
    n_drives = len(finding.drive_ids)
    by = cameras if n_drives == 1 else say(lang, "seen.by_drives", cameras=cameras, n=n_drives)
    stamps = [seen[key] for key in ("first", "last") if seen.get(key)]
    known = [dt.date.fromisoformat(stamp[:10]) for stamp in stamps] or list(days)
    absence = finding.terms.get("absence")
    state = "seen.seen" if absence is None else "seen.not_seen" if alone else "seen.looked_for"
    when = ""
    if known:
        first, last = min(known), max(known)
        key = "seen.on" if first == last else "seen.between"
        when = f" {say(lang, key, first=first, last=last)}"
    told = say(lang, state, when=when, by=by)
    if absence is None or not alone:
        return told
    return f"{told} {say(lang, 'seen.in_view', n=absence['frames'])}"


def position_sentence(radius95_m: float, lang: Lang = Lang.EN, *, limit_m: float = 1.0) -> str:
    """Say how well a place is known: sure where 95 % of it lies within the limit, NVDB's own requirement."""
    key = "seen.position_sure" if radius95_m <= limit_m else "seen.position_unsure"
    return say(lang, key, radius_m=radius95_m)
