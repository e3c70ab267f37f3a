"""What a user may import from ``geoloc``."""

from __future__ import annotations

import pkgutil
import subprocess
import sys

import geoloc


def test_face_lists_what_it_hands_on() -> None:
    """Every name is there, stands in the docstring, and is none of a module inside."""
    assert len(geoloc.__all__) == 25
    assert all(hasattr(geoloc, name) and f"`{name}" in str(geoloc.__doc__) for name in geoloc.__all__)
    assert not set(geoloc.__all__) & {module.name for module in pkgutil.iter_modules(geoloc.__path__)}


def test_import_of_geoloc_loads_nothing_heavy() -> None:
    """A name costs its import when it is first used, not before."""
    code = "import sys, geoloc; print('numpy' in sys.modules, geoloc.adjust.__name__, 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "adjust", "True"]
