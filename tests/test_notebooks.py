"""The notebooks run, and show what they showed when they were last kept."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from checkout import ROOT

with warnings.catch_warnings():
    # Of its own dependencies, at import.
    warnings.simplefilter("ignore")
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def shown(notebook: Any) -> Iterator[str]:
    """What the cells print and what tables they end in; a figure is only told to be there."""
    for cell in notebook.cells:
        text = ""
        for output in cell.get("outputs", []):
            assert output.output_type != "error"
            data = output.get("data", {})
            text += "a figure" if "image/png" in data else output.get("text") or data["text/plain"]
        yield text


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "path",
    [pytest.param(one, marks=[pytest.mark.slow] * (one.stem == "paper_experiments")) for one in NOTEBOOKS],
    ids=lambda path: path.stem,
)
def test_notebook_shows_what_it_showed(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same words, and numbers that differ by no more than another processor's rounding can make."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    kept = nbformat.read(path, as_version=4)
    again = nbformat.from_dict(json.loads(json.dumps(kept)))
    nbclient.NotebookClient(again, timeout=300, resources={"metadata": {"path": tmp_path}}).execute()
    for before, after in zip(shown(kept), shown(again), strict=True):
        assert _NUMBER.sub("#", before) == _NUMBER.sub("#", after)
        numbers = [float(one) for one in _NUMBER.findall(before)]
        assert [float(one) for one in _NUMBER.findall(after)] == pytest.approx(numbers, rel=0.02, abs=0.021)


def test_there_are_notebooks() -> None:
    """Both have been run: every cell of code has its number."""
    assert [path.stem for path in NOTEBOOKS] == ["my_camera", "paper_experiments"]
    for path in NOTEBOOKS:
        cells = [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == "code"]
        assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
