"""Where the checkout lies, and the real recordings beside it."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
REAL = ROOT.parent / "shared" / "real"
"""Recordings and answers that may not be copied into the project; the tests that read them skip without."""
