"""What a user may import from ``twin`` and from its rooms."""

from __future__ import annotations

import importlib
import pkgutil
import subprocess
import sys

import pytest

import twin

FACES = ["twin", *(f"twin.{room.name}" for room in pkgutil.iter_modules(twin.__path__) if room.ispkg)]


@pytest.mark.parametrize("name", FACES)
def test_face_hands_on_what_it_names(name: str) -> None:
    """Every name is there, and none is that of a module inside, which would take its place once imported."""
    face = importlib.import_module(name)
    names = set(getattr(face, "__all__", []))
    assert all(hasattr(face, each) for each in names)
    assert not names & {module.name for module in pkgutil.iter_modules(face.__path__)}


def test_face_of_twin_is_the_whole_job() -> None:
    """Each command of the job is one function; its docstring lists them all."""
    names = {"Store", "TwinError", "decide", "evaluate", "export_findings", "ingest_drive", "match"}
    assert set(twin.__all__) == {*names, "__version__", "read_truth", "sync_nvdb", "undo"}
    assert all(name in str(twin.__doc__) for name in twin.__all__ if name != "__version__")


def test_import_of_twin_loads_nothing_heavy() -> None:
    """A name costs its import when it is first used, not before."""
    code = (
        "import sys, twin, twin.store, twin.mirror\n"
        "print(sorted({'numpy', 'sqlalchemy', 'requests', 'importlib.metadata'} & set(sys.modules)))\n"
        "print(twin.Store.__name__, 'sqlalchemy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[]", "Store True"]
