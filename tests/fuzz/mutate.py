"""Damaged files: small sound ones, bent in the ways that files are damaged or forged.

A fuzz test of a parser::

    @settings(max_examples=EXAMPLES)
    @given(mutated([b"a small sound file", *real_files("gnss", ".log")]))
    def test_reader_raises_nothing_but_drive_errors(content: bytes) -> None: ...

``TWIN_FUZZ_EXAMPLES=100000 pytest tests/fuzz`` looks longer. The same number draws the same files.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from hypothesis import strategies as st

EXAMPLES = int(os.environ.get("TWIN_FUZZ_EXAMPLES", "60"))
"""Inputs that each fuzz test tries."""

REAL = Path(__file__).resolve().parents[2].parent / "shared" / "real"
LARGEST_SEED_BYTES = 20_000
"""Real files are cut to this: a parser has seen what there is long before, and inputs stay fast."""

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_TOKENS = (
    *(b"0", b"-1", b"1e999", b"-1e308", b"1e-320", b"9" * 40, b"9" * 5000, b"nan", b"NaN", b"Infinity"),
    *(
        b"-inf",
        b"0x10",
        b"\xd9\xa3",
        b"1_0",
        b"null",
        b"true",
        b'""',
        b"[]",
        b"{}",
        b"[" * 3000,
        b'{"a":' * 400,
    ),
    *(b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\xc3", b"\r\n", b"\n\n", b",,,", b";", b":", b"\t", b'"', b"'"),
    *(
        b"<",
        b">",
        b"&a;",
        b"<!DOCTYPE a>",
        b"<a>" * 500,
        b"../../x",
        b"/",
        b"\\",
        b"C:\\x",
        b"%s%n",
        b"=",
        b"$",
    ),
    *(b"2026-13-45T99:99:99Z", b"18446744073709551616", b"9223372036854775807", b"-9223372036854775809"),
)
_KINDS = ("flip", "cut", "head", "drop", "repeat", "insert", "replace", "swap", "number", "number", "splice")


class _Edit(NamedTuple):
    """One change of a file; places and lengths are parts of 65,536 of it."""

    kind: str
    place: int
    length: int
    token: bytes


_EDITS = st.lists(
    st.builds(
        _Edit,
        st.sampled_from(_KINDS),
        st.integers(0, 65_535),
        st.integers(0, 65_535),
        st.sampled_from(_TOKENS) | st.binary(max_size=6),
    ),
    max_size=6,
)


def mutated(seeds: Sequence[bytes]) -> st.SearchStrategy[bytes]:
    """Draw files that begin as one of the seeds and suffer up to six changes.

    Bytes are flipped, inserted, left out, repeated and swapped, the file is cut at either end, numbers become
    others that are too large, too many or none, and pieces of another seed get in between. Now and then
    the file is a seed as it is, or nothing but noise.

    Parameters
    ----------
    seeds : sequence of bytes
        At least one sound file.

    Returns
    -------
    SearchStrategy of bytes
        At most about four times as long as the seed.
    """
    kept = [seed[:LARGEST_SEED_BYTES] for seed in seeds]
    damaged = st.tuples(st.sampled_from(kept), _EDITS, st.sampled_from(kept)).map(
        lambda drawn: _edited(*drawn)
    )
    noise = st.binary(max_size=60)
    return damaged | damaged | damaged | noise


def real_files(folder: str, *suffixes: str) -> list[bytes]:
    """Read the recorded files below ``shared/real/<folder>``, by suffix; none where they are absent."""
    root = REAL / folder
    files = sorted(path for path in root.rglob("*") if path.is_file()) if root.is_dir() else []
    return [_head(path) for path in files if not suffixes or path.name.lower().endswith(suffixes)]


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(LARGEST_SEED_BYTES)


def _edited(content: bytes, edits: Sequence[_Edit], other: bytes) -> bytes:
    most = 4 * len(content) + 40_000
    for edit in edits:
        content = _edit(content, edit, other)[:most]
    return content


def _edit(content: bytes, edit: _Edit, other: bytes) -> bytes:
    """Return the file with one change."""
    start = edit.place * len(content) >> 16
    # Short pieces are the usual damage, long ones are drawn too.
    end = min(len(content), start + 1 + (edit.length**2 * len(content) >> 33))
    before, piece, after = content[:start], content[start:end], content[end:]
    if edit.kind == "number":
        return _with_other_number(content, start, edit.token)
    pieces = {
        "flip": (before, bytes(byte ^ (1 + edit.length % 255) for byte in piece[:1]), piece[1:], after),
        "cut": (before,),
        "head": (piece, after),
        "drop": (before, after),
        "repeat": (before, piece * (2 + edit.length % 30), after),
        "insert": (before, edit.token, piece, after),
        "replace": (before, edit.token, after),
        "swap": (after, piece, before),
        "splice": (before, other[edit.length * len(other) >> 16 :][: len(piece) + 40], after),
    }
    return b"".join(pieces[edit.kind])


def _with_other_number(content: bytes, start: int, token: bytes) -> bytes:
    """Replace the first number from `start` on."""
    found = _NUMBER.search(content, start)
    return content if found is None else content[: found.start()] + token + content[found.end() :]
