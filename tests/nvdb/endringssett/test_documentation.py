"""The code on the page about change sets runs, and makes the XML that the page shows."""

from __future__ import annotations

import re
from typing import Any

import pytest
from checkout import ROOT

PAGE = ROOT / "docs" / "endringssett.md"


def test_documented_example_runs_and_makes_the_documented_xml() -> None:
    """Correction, checks, dry run and sending as shown; the first object is written as shown."""
    if not PAGE.exists():
        pytest.skip("docs are not beside the tests")
    text = PAGE.read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(compile(block, str(PAGE), "exec"), names)
    shown, _ = re.findall(r"```xml\n(.*?)```", text, flags=re.DOTALL)
    written = names["document"].decode()
    assert "".join(shown.split()) in "".join(written.split())
    assert names["status"].sentences()[0].endswith("UTFØRT, 2 objects.")
