"""How commands tell of findings: in which language, with which names."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from twin.words import Lang, SignNames, seen_sentence

if TYPE_CHECKING:
    from twin.decisions.findings import FindingStatus
    from twin.mirror.roads import Road
    from twin.store.records import Finding
    from twin.store.store import Store


@dataclass(frozen=True, slots=True)
class Told:
    """In which language findings are told, with which names of signs and roads."""

    lang: Lang
    names: SignNames
    roads: Mapping[str, Road]
    days: Mapping[str, dt.date]

    def seen(self, finding: Finding) -> str:
        """When a finding's sign was seen, or looked for: to be followed by its reason."""
        days = [self.days[drive] for drive in finding.drive_ids if drive in self.days]
        return seen_sentence(finding, self.lang, days, alone=False)


def told_in(store: Store, changes: Sequence[FindingStatus], lang: Lang) -> Told:
    """Look up what these findings need to be told in a language."""
    from twin.decisions.findings import drive_days
    from twin.mirror.names import sign_names
    from twin.mirror.roads import roads_of

    asked = [change.finding for change in changes if not change.is_quiet]
    return Told(lang, sign_names(store), roads_of(store, asked), drive_days(store.rows))
