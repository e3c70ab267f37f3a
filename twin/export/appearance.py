"""The verdicts and how they look: one table for the QGIS style, the picture and the manual."""

from __future__ import annotations

from dataclasses import dataclass

from twin.store.kinds import Decision, Verdict


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
    marker : str
        QGIS's name of the shape.
    angle_deg : float
        The shape's rotation.
    mpl_marker : str
        Matplotlib's name of the same shape.
    size_mm : float
    """

    verdict: Verdict
    label: str
    colour: str
    marker: str
    angle_deg: float
    mpl_marker: str
    size_mm: float


# After Okabe & Ito (Color Universal Design, 2008), apart for every kind of colour vision; pale where there is
# nothing to decide. Drawn in this order, so that what matters most lies on top.
MARKS: tuple[Mark, ...] = (
    Mark(Verdict.UNCHANGED, "Unchanged", "#a9adb2", "circle", 0.0, "o", 2.0),
    Mark(Verdict.NOT_OBSERVABLE, "Not observable", "#56b4e9", "circle", 0.0, "o", 2.4),
    Mark(Verdict.REVIEW, "Review", "#0072b2", "square", 0.0, "s", 3.2),
    Mark(Verdict.MOVED, "Moved", "#e69f00", "triangle", 0.0, "^", 4.0),
    Mark(Verdict.WRONG_TYPE, "Wrong type", "#aa3377", "diamond", 0.0, "D", 4.2),
    Mark(Verdict.NEW, "New", "#009e73", "cross_fill", 0.0, "P", 4.8),
    Mark(Verdict.MISSING, "Missing", "#d55e00", "cross_fill", 45.0, "X", 4.8),
)

MARK: dict[str, Mark] = {mark.verdict: mark for mark in MARKS}

DECISION_LABELS: dict[str, str] = {decision: decision.capitalize() for decision in Decision}
"""Value of the column ``decision`` → its label. Every change starts as ``open``."""

OTHER_COLOUR = "#000000"
"""The rim of a value that is none of the above, e.g. typed by hand."""
ESTIMATE_COLOUR = "#1b2a41"
NVDB_COLOUR = "#5e4fa2"
DRIVE_COLOUR = "#5b7083"


SIGMAS_95 = 2.4477468306808166
"""Half axis of the 95 % ellipse of a two-dimensional Gaussian, in sigmas: sqrt(-2 ln 0.05)."""
