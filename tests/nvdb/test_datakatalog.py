"""Sign codes and ids."""

from __future__ import annotations

import pytest

from nvdb.datakatalog import EGENSKAPER_96, SKILTNUMMER_ENUM, is_retired, sign_code, sign_family


@pytest.mark.parametrize(
    ("verdi", "code", "family"),
    [
        ("362.50 - Fartsgrense, 50 km/t", "362.50", "362"),
        ("906H - Hindermarkering, hinder til høyre", "906H", "906"),
        ("727.3K - Administrativ grense. Kommunegrenseskilt", "727.3K", "727"),
        ("711.V90 - Tabellvegviser, Venstre, 90 grader", "711.V90", "711"),
        ("U722.2 - Vegviser for vegkryss", "U722.2", "U722"),
        ("202", "202", "202"),
        ("  512: Holdeplass", "512", "512"),
    ],
)
def test_sign_code_is_the_first_word(verdi: str, code: str, family: str) -> None:
    """The code is what stands before the description; its family is the number without the variant."""
    assert sign_code(verdi) == code
    assert sign_family(code) == family
    assert is_retired(code) == code.startswith("U")


@pytest.mark.parametrize("verdi", ["", "Annet", "- 362", "U", "12 - x", "362km", "Utgår 362"])
def test_sign_code_of_something_else_is_none(verdi: str) -> None:
    """Text that does not begin with a code gives none."""
    assert sign_code(verdi) is None


def test_sign_codes_of_the_snapshot_are_codes_with_ids_of_their_own() -> None:
    """Every shipped code reads as itself, and no enum id is used twice."""
    assert all(sign_code(f"{code} - x") == code for code in SKILTNUMMER_ENUM)
    assert len(set(SKILTNUMMER_ENUM.values())) == len(SKILTNUMMER_ENUM)
    assert 5530 in EGENSKAPER_96
