"""How a sign code (Skiltnummer) is read out of what people and catalogues write."""

from __future__ import annotations

import re
from functools import lru_cache

_CODE = re.compile(r"U?\d{3,4}[A-ZÆØÅ]{0,3}(\.[0-9A-ZÆØÅ]+)*(?=[\s,:;-]|$)")
_FAMILY = re.compile(r"U?\d+")


@lru_cache(maxsize=4096)
def sign_code(verdi: str) -> str | None:
    """Sign code of a value of 5530: its first word, or None if that is no code.

    >>> sign_code("362.50 - Fartsgrense, 50 km/t")
    '362.50'
    """
    match = _CODE.match(verdi.strip())
    return match.group() if match else None


def sign_family(code: str) -> str:
    """Family of a sign code: what is left without the variant. A retired code keeps its ``U``.

    >>> sign_family("362.50"), sign_family("906H"), sign_family("U722.2")
    ('362', '906', 'U722')
    """
    match = _FAMILY.match(code)
    return match.group() if match else code


def is_retired(code: str) -> bool:
    """Whether a sign code is one that is no longer put up (``U…``, *utgått*) but still stands on objects."""
    return code.startswith("U")
