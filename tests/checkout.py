"""Where the checkout lies, and the real recordings beside it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
REAL = ROOT.parent / "shared" / "real"
"""Recordings and answers that may not be copied into the project; the tests that read them skip without."""


def code_block(page: str, kind: str, after: str = "") -> str:
    """The first code block of a kind on a page of ``docs/``, after a heading of it if that is named."""
    path = ROOT / "docs" / page
    if not path.exists():
        pytest.skip("docs are not beside the tests")
    text = path.read_text(encoding="utf-8")
    block = re.search(rf"```{kind}\n(.*?)```", text[text.index(after) :], flags=re.DOTALL)
    assert block
    return block[1]
