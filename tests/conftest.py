"""Settings that every test shares."""

from __future__ import annotations

from hypothesis import settings

# A clock never decides a test, and every run draws the same examples.
settings.register_profile("twin", deadline=None, derandomize=True, database=None, max_examples=60)
settings.load_profile("twin")
