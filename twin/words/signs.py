"""Names of sign codes: ``142 – Barn``, and the code alone where nobody has told its name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from nvdb.datakatalog import sign_code

SignNames = Mapping[str, str]
"""Sign code → its name in the datakatalog (:func:`twin.mirror.names.sign_names` reads them)."""
NO_NAMES: SignNames = {}


def name_in(verdi: str) -> tuple[str, str] | None:
    """Return code and name of a value of 5530 as NVDB writes it; None where it is the code alone, or no code.

    >>> name_in("362.50 - Fartsgrense, 50 km/t")
    ('362.50', 'Fartsgrense, 50 km/t')
    """
    code = sign_code(verdi)
    if code is None:
        return None
    name = verdi.strip()[len(code) :].strip(" -–:;,\t")
    return (code, name) if name else None


def sign_title(code: str, names: SignNames = NO_NAMES) -> str:
    """``142 – Barn``; the code alone where its name is not known."""
    name = names.get(code)
    return f"{code} – {name}" if name else code


def sign_titles(codes: Iterable[str], names: SignNames = NO_NAMES, *, between: str = " + ") -> str:
    """Join the titles of the plates of a pole, top down; "" of none."""
    return between.join(sign_title(code, names) for code in codes)
