"""What the machine refuses: memory, space on a disk, rights to a file. One sentence each, for all commands.

OpenBLAS, which NumPy and SciPy each bring, does not fail where it gets no memory: it tries again and again,
for minutes, and then ends the process. So there is to be enough before such a library is loaded.
"""

from __future__ import annotations

import mmap
import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from typing import Any

from twin.cli.exit_codes import EXIT_DATA, EXIT_MACHINE
from twin.errors import CURES

_MB = 1 << 20
_NEEDED_MB = {"numpy": 128, "scipy.linalg": 176, "geopandas": 300}
"""Of address space. The first two with OpenBLAS in one thread: its library, its first buffer, and what is
loaded before that is asked for. The last brings pandas and GDAL, which crash where they get too little."""
_SPARE_MB = 64
"""No library is loaded, and nothing is computed, with less than this."""

_NO_MEMORY = (
    "There is too little memory: close other programs, or allow this process more (ulimit -v unlimited). "
    "What was done so far is kept."
)


class _BeforeLoading(MetaPathFinder):
    """Finds no module, but looks for memory first."""

    def find_spec(self, fullname: str, _path: Sequence[str] | None, _target: Any = None, /) -> None:
        if fullname in _NEEDED_MB and not _is_there(_NEEDED_MB[fullname]):
            raise MemoryError


def watch_memory() -> None:
    """Let loading a library that would wait for memory raise MemoryError."""
    if _is_limited():
        # Each thread of each OpenBLAS takes 40 MB, and there are as many as cores.
        os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.meta_path.insert(0, _BeforeLoading())


def refusal(error: Exception) -> tuple[int, str] | None:
    """Return exit code and sentence where an unexpected exception comes of what the machine refuses."""
    # Of too little memory libraries complain in many ways.
    if isinstance(error, MemoryError) or not _is_there(_SPARE_MB):
        return EXIT_MACHINE, _NO_MEMORY
    if isinstance(error, OSError) and error.errno in CURES:
        what = f"{error.filename} cannot be used" if error.filename else "A file cannot be written"
        return EXIT_DATA, f"{what} ({error.strerror}): {CURES[error.errno]}."
    return None


def _is_limited() -> bool:
    if sys.platform == "win32":
        return False
    import resource

    return resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY


def _is_there(megabytes: int) -> bool:
    """Whether so much address space can be had; none of it is used."""
    try:
        mmap.mmap(-1, megabytes * _MB).close()
    except OSError:
        return False
    return True
