"""Norwegian sign codes in what annotators write."""

from __future__ import annotations

import re

# A code of the sign regulation (skiltforskriften) as the vegobjekt skiltplate spells it: "202", "362.50",
# "906H", "727.3K", and the retired "U324". It ends where no further letter, digit or part follows, so that
# a year, a house number or a cut word is not read as a code.
_CODE = r"U?\d{3}[A-ZÆØÅ]?(?:\.[0-9A-ZÆØÅ]+)*(?![0-9A-Za-zÆØÅæøå]|\.[0-9A-Za-zÆØÅæøå])"
_AT_START = re.compile(rf"\s*(?:(?:skilt|sign)(?:nummer|plate)?[\s_:\-]*)?({_CODE})", re.IGNORECASE)
_CASED = re.compile(_CODE)
# "362,50": the decimal comma of a Norwegian keyboard. Two codes in a list never look like it, since the
# second has three digits.
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d{1,2}(?!\d))")
_BETWEEN_CODES = re.compile(r"[;|+\n]|,")


def codes_from_attribute(text: str) -> str:
    """Sign codes of the attribute ``skiltnummer``, top down, joined by ``;``.

    Parameters
    ----------
    text : str
        As annotators write it: ``362.50``, ``362.50;808.1``, ``362,50 Fartsgrense``, ``906h``.

    Returns
    -------
    str
        "362.50;808.1"; "" where there is no code in it.
    """
    parts = _BETWEEN_CODES.split(_DECIMAL_COMMA.sub(".", text))
    found = (_AT_START.match(part) for part in parts)
    return ";".join(match.group(1).upper() for match in found if match)


def codes_from_label(label: str) -> str:
    """Sign codes of a label that begins with one: ``362.50 Fartsgrense``, ``skilt_906H``, ``362.50;808``.

    Returns
    -------
    str
        The codes joined by ``;``, "" where the label does not begin with one. Letters count only in
        capitals: ``100m`` is a distance, not a sign.
    """
    codes = []
    for part in label.split(";"):
        match = _AT_START.match(part)
        if not match or not _CASED.fullmatch(match.group(1)):
            break
        codes.append(match.group(1))
    return ";".join(codes)
