"""The system's Python, which has QGIS's bindings; ours has not."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

SYSTEM_PYTHON = "/usr/bin/python3"
ENVIRONMENT = {
    # A French desktop would write 0,25: the map tips must not depend on the test machine's language.
    "PATH": os.environ.get("PATH", ""),
    "HOME": os.environ.get("HOME", "/"),
    "LC_ALL": "C.UTF-8",
    "QT_QPA_PLATFORM": "offscreen",
}


def need_qgis() -> None:
    """Skip the test where QGIS is not installed."""
    if not Path(SYSTEM_PYTHON).exists():
        pytest.skip("no system Python")
    probe = [SYSTEM_PYTHON, "-c", "import qgis.core"]
    if subprocess.run(probe, capture_output=True, check=False, env=ENVIRONMENT).returncode:
        pytest.skip("QGIS's Python bindings are not installed")
