"""The verdicts and how they look: one table for the QGIS style, the picture and the manual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from twin.decisions.log import OPEN

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, slots=True)
class Verdict:
    """One verdict of a change.

    Attributes
    ----------
    name : str
        As written in the column ``verdict``.
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
    meaning : str
        One clause for the legend's reader.
    """

    name: str
    label: str
    colour: str
    marker: str
    angle_deg: float
    mpl_marker: str
    size_mm: float
    meaning: str


# After Okabe & Ito (Color Universal Design, 2008), apart for every kind of colour vision; pale where there is
# nothing to decide. Drawn in this order, so that what matters most lies on top.
VERDICTS: tuple[Verdict, ...] = (
    Verdict("unchanged", "Unchanged", "#a9adb2", "circle", 0.0, "o", 2.0, "NVDB and the road agree"),
    Verdict(
        "not_observable", "Not observable", "#56b4e9", "circle", 0.0, "o", 2.4, "no drive could have seen it"
    ),
    Verdict("review", "Review", "#0072b2", "square", 0.0, "s", 3.2, "more than one reading is possible"),
    Verdict("moved", "Moved", "#e69f00", "triangle", 0.0, "^", 4.0, "the sign stands elsewhere than in NVDB"),
    Verdict("wrong_type", "Wrong type", "#aa3377", "diamond", 0.0, "D", 4.2, "not the sign code in NVDB"),
    Verdict("new", "New", "#009e73", "cross_fill", 0.0, "P", 4.8, "on the road, not in NVDB"),
    Verdict("missing", "Missing", "#d55e00", "cross_fill", 45.0, "X", 4.8, "in NVDB, not on the road"),
)

VERDICT: dict[str, Verdict] = {verdict.name: verdict for verdict in VERDICTS}

DECISIONS: dict[str, str] = {OPEN: "Open", "accept": "Accept", "dismiss": "Dismiss", "defer": "Defer"}
"""Value of the column ``decision`` → its label. Every change starts as ``open``."""

OTHER_COLOUR = "#000000"
"""The rim of a value that is none of the above, e.g. typed by hand."""
ESTIMATE_COLOUR = "#1b2a41"
NVDB_COLOUR = "#5e4fa2"
DRIVE_COLOUR = "#5b7083"


SIGMAS_95 = 2.4477468306808166
"""Half axis of the 95 % ellipse of a two-dimensional Gaussian, in sigmas: sqrt(-2 ln 0.05)."""
