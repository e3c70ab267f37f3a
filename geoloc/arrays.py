"""The arrays of the house by what they hold: float64 numbers, int64 counts and epochs, masks, texts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]
TextArray = NDArray[np.str_]
