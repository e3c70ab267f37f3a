"""A network is tried out in a process of its own before it is let into this one.

A damaged ONNX file can end the process that loads it: OpenCV's importer trusts what the file says of itself.
In a child that costs one sentence instead of the whole run, and a network that does not fit is found before
hours of video are decoded.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path

from twin.errors import DriveError

_BAD_DATA = 4
_LONGEST_S = 300
"""A network that takes longer for one picture would take a year for an hour of video."""


def rehearse(model: Path) -> None:
    """Load a network and run it on one empty picture, in a child process.

    Parameters
    ----------
    model : Path
        ONNX file.

    Raises
    ------
    DriveError
        If it cannot be read, is not of the contract, or ends the process.
    """
    try:
        known = model.stat()
    except OSError as error:
        raise DriveError(
            f"The detector {model} cannot be read ({error.strerror}): name an ONNX file."
        ) from error
    reason = _tried(str(model.resolve()), known.st_mtime_ns, known.st_size)
    if reason:
        raise DriveError(reason)


@cache
def _tried(model: str, _mtime_ns: int, _size: int) -> str:
    """Why a network cannot be used; "" if it can."""
    name = Path(model).name
    try:
        child = subprocess.run(  # noqa: S603 - this interpreter, and a file name as an argument
            [sys.executable, "-P", "-m", __name__, model],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            capture_output=True,
            timeout=_LONGEST_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"{name} took more than {_LONGEST_S} s for one picture: export a smaller network."
    except OSError as error:
        raise DriveError(f"The detector cannot be tried out ({error.strerror}).") from error
    if child.returncode == 0:
        return ""
    said = child.stdout.decode("utf-8", "replace").strip()
    if child.returncode == _BAD_DATA and said:
        return said
    return (
        f"{name} makes OpenCV crash: the file is damaged, or uses ONNX in a way that OpenCV does not know."
        " Export it again, with opset 17 or older."
    )


def main(model: str) -> int:
    """Run in the child: 0 if the network can be used, else `_BAD_DATA` with the reason on stdout."""
    import numpy as np

    from twin.drives.detection.network import Detector

    try:
        Detector(Path(model)).find(np.zeros((64, 96, 3), dtype=np.uint8), 0.5, Counter())
    except DriveError as error:
        sys.stdout.buffer.write(str(error).encode())
        return _BAD_DATA
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
