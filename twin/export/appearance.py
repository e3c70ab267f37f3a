"""How verdicts look: one table for the picture and, held by a test, for the QGIS styles."""

from __future__ import annotations

from dataclasses import dataclass

from twin.store.kinds import Verdict


@dataclass(frozen=True, slots=True)
class Mark:
    """How the changes of one verdict look on a map.

    Attributes
    ----------
    verdict : Verdict
    label : str
        For legends and forms.
    colour : str
        ``#rrggbb``. Shape and size repeat what the colour says, for eyes and printers that lose it.
    mpl_marker : str
        Matplotlib's name of the shape.
    size_mm : float
    """

    verdict: Verdict
    label: str
    colour: str
    mpl_marker: str
    size_mm: float


# After Okabe & Ito (Color Universal Design, 2008), apart for every kind of colour vision; grey where there is
# nothing to decide, dark enough for white paper (3:1). Drawn in this order: what matters most lies on top.
MARKS: tuple[Mark, ...] = (
    Mark(Verdict.UNCHANGED, "Unchanged", "#8f93a0", "o", 2.0),
    Mark(Verdict.NOT_OBSERVABLE, "Not observable", "#56b4e9", "o", 2.4),
    Mark(Verdict.REVIEW, "Review", "#0072b2", "s", 3.2),
    Mark(Verdict.MOVED, "Moved", "#e69f00", "^", 4.0),
    Mark(Verdict.WRONG_TYPE, "Wrong type", "#aa3377", "D", 4.2),
    Mark(Verdict.NEW, "New", "#009e73", "P", 4.8),
    Mark(Verdict.MISSING, "Missing", "#d55e00", "X", 4.8),
)

MARK: dict[str, Mark] = {mark.verdict: mark for mark in MARKS}

ESTIMATE_COLOUR = "#1b2a41"
NVDB_COLOUR = "#5e4fa2"
DRIVE_COLOUR = "#5b7083"
BELIEF_COLOURS = ("#d55e00", "#f0e442", "#56b4e9", "#0072b2", "#ffffff")
"""Gone, unsure, probably stands, stands, no drive has passed."""
ROAD_COLOURS = ("#d55e00", "#e69f00", "#8f93a0")
"""Roads of which a drive settles much, some, little."""
