"""One thing that is wrong with a change set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

FEIL: Final = "feil"
ADVARSEL: Final = "advarsel"


@dataclass(frozen=True, slots=True)
class ValidationFinding:
    """One thing that is wrong; ``str()`` is a sentence: where, what, cure.

    Attributes
    ----------
    severity : {"feil", "advarsel"}
        ``feil``: the set would be refused.
    code : str
        API Skriv's own code where it has one.
    where, clause : str
        The object or the set; what is wrong there and the cure.
    temp_id, nvdb_id, versjon, egenskap_type_id
        The same for a machine; None where it does not apply.
    """

    severity: str
    code: str
    where: str
    clause: str
    temp_id: str | None = None
    nvdb_id: int | None = None
    versjon: int | None = None
    egenskap_type_id: int | None = None

    def __str__(self) -> str:
        return f"{self.where} {self.clause}."
