"""Settings that every test shares."""

from __future__ import annotations

import os
import sys

from hypothesis import settings

# Before NumPy is loaded: matrices are small here, and the threads of several workers on the same cores wait
# for one another, up to eight times as long.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# What the person who runs the tests has set in a twin.toml of their own is none of the tests' business.
os.environ["XDG_CONFIG_HOME"] = "/nonexistent"

# A process that a test starts has the bytecode of those before it, also where the environment keeps none:
# compiling our modules is a third of what a short command costs.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A clock never decides a test, and every run draws the same examples.
settings.register_profile("twin", deadline=None, derandomize=True, database=None, max_examples=60)
settings.load_profile("twin")
