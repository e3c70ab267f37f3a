"""Settings that every test shares."""

from __future__ import annotations

import os

from hypothesis import settings

# Before NumPy is loaded: matrices are small here, and the threads of several workers on the same cores wait
# for one another, up to eight times as long.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A clock never decides a test, and every run draws the same examples.
settings.register_profile("twin", deadline=None, derandomize=True, database=None, max_examples=60)
settings.load_profile("twin")
