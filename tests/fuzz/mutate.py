"""Damaged files: small sound ones, bent in the ways that files are damaged or forged.

A fuzz test of a parser is run over and over, each time with arguments that are drawn anew::

    @fuzzed(mutated([b"a small sound file", *real_files("gnss", ".log")]))
    def test_reader_raises_nothing_but_drive_errors(content: bytes) -> None: ...

``TWIN_FUZZ_EXAMPLES=100000 pytest tests/fuzz`` looks longer (``make fuzz``). An input is drawn from
``TWIN_FUZZ_SEED``, the test's name and its number: the same three give the same input, and
``TWIN_FUZZ_FIRST`` with ``TWIN_FUZZ_EXAMPLES=1`` gives one of them alone. It is a plain loop: Hypothesis
takes longer to draw an input than most parsers to refuse it.
"""

from __future__ import annotations

import copy
import functools
import inspect
import json
import os
import re
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random
from typing import Any

from checkout import REAL

EXAMPLES = int(os.environ.get("TWIN_FUZZ_EXAMPLES", "150"))
"""Inputs that each fuzz test tries."""
_FIRST = int(os.environ.get("TWIN_FUZZ_FIRST", "0"))
_SEED = os.environ.get("TWIN_FUZZ_SEED", "0")
_LONGEST_SHOWN = 3000

LARGEST_SEED_BYTES = 20_000
"""Real files are cut to this: a parser has seen what there is long before, and inputs stay fast."""

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_TOKENS = (
    *(b"0", b"-1", b"1e999", b"-1e308", b"1e-320", b"9" * 40, b"9" * 5000, b"nan", b"NaN", b"Infinity"),
    *(b"-inf", b"0x10", b"\xd9\xa3", b"1_0", b"null", b"true", b'""', b"[]", b"{}"),
    *(b"[" * 3000, b'{"a":' * 400, b"<a>" * 500),
    *(b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\xc3", b"\r\n", b"\n\n", b",,,", b";", b":", b"\t", b'"', b"'"),
    *(b"<", b">", b"&a;", b"<!DOCTYPE a>", b"../../x", b"/", b"\\", b"C:\\x", b"%s%n", b"=", b"$"),
    *(b"2026-13-45T99:99:99Z", b"18446744073709551616", b"9223372036854775807", b"-9223372036854775809"),
)
_VALUES = (
    *(None, True, False, 0, 1, -1, 2**31, 2**63, -(2**64), 10**30, 0.5, -0.0, 1e308, 1e-320),
    *(float("nan"), float("inf"), -float("inf"), "", "0", "1.5", "nan", "a", "\0", "\ud800", "é" * 300),
    *("../../x", "/etc/passwd", [], {}, [[]], [0, 1], [1.5, 2.5, 3.5, 4.5], {"a": 1}, [None], ["a"] * 40),
)
_KINDS = ("flip", "cut", "head", "drop", "repeat", "insert", "replace", "swap", "number", "number", "splice")
_MOST_EDITS = 6
_LONGEST_NOISE = 60

Draw = Callable[[Random], Any]


def fuzzed(*draws: Draw, parsers: int = 1) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Run a test `EXAMPLES` times for each of its parsers; its last parameters are what `draws` give.

    A failure names the input, and how to run it alone. What the test prints at its end, shown by ``pytest
    -rP``, is how many inputs it tried, how many a second of processor time, and which took longest.
    """

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(test)
        def run(**given: Any) -> None:
            slowest, begun = (0.0, 0), time.process_time()
            count = EXAMPLES if _FIRST else EXAMPLES * parsers
            for number in range(_FIRST, _FIRST + count):
                before = time.process_time()
                _once(test, draws, number, given)
                slowest = max(slowest, (time.process_time() - before, number))
            rate = count / max(time.process_time() - begun, 1e-9)
            longest = f"longest {slowest[0]:.2f} s (input {slowest[1]})"
            sys.stdout.write(f"{count} inputs, {rate:.0f} a second, {longest}\n")

        parameters = list(inspect.signature(test).parameters.values())
        run.__signature__ = inspect.Signature(parameters[: -len(draws)])  # type: ignore[attr-defined]
        return run

    return decorate


def _once(test: Callable[..., None], draws: Sequence[Draw], number: int, given: dict[str, Any]) -> None:
    """Run a test on its input of this number."""
    random = Random(f"{_SEED} {test.__name__} {number}")
    drawn = [draw(random) for draw in draws]
    try:
        test(*given.values(), *drawn)
    except Exception as error:
        shown = repr(drawn)[:_LONGEST_SHOWN]
        error.add_note(
            f"TWIN_FUZZ_SEED={_SEED} TWIN_FUZZ_FIRST={number} TWIN_FUZZ_EXAMPLES=1 gives this input: {shown}"
        )
        raise


def mutated(seeds: Sequence[bytes]) -> Draw:
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
    callable of Random to bytes
        At most about four times as long as the seed.
    """
    kept = [seed[:LARGEST_SEED_BYTES] for seed in seeds]

    def draw(random: Random) -> bytes:
        if random.random() < 0.05:
            return random.randbytes(random.randrange(_LONGEST_NOISE))
        content, other = random.choice(kept), random.choice(kept)
        most = 4 * len(content) + 40_000
        for _ in range(random.randrange(_MOST_EDITS + 1)):
            content = _edited(content, other, random)[:most]
        return content

    return draw


def mutated_json(documents: Sequence[Any]) -> Draw:
    """Draw JSON that is sound, but says up to four things that it should not.

    Values become others of any type, and keys and list entries are left out or given twice.
    """
    texts = [json.dumps(document) for document in documents]

    def draw(random: Random) -> bytes:
        document = [json.loads(random.choice(texts))]
        for _ in range(random.randrange(5)):
            _bend(document, random)
        return json.dumps(document[0]).encode()

    return draw


def _bend(node: Any, random: Random) -> None:
    """Change one thing somewhere below a list or an object that is not empty."""
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = random.choice(keys)
        child = node[key]
        if not (isinstance(child, (dict, list)) and child) or random.random() < 0.1:
            break
        node = child
    if random.random() < 0.2 and len(keys) > 1:
        del node[key]
    elif random.random() < 0.2 and isinstance(node, list):
        node += [child] * random.randint(1, 9)
    else:
        node[key] = copy.deepcopy(random.choice(_VALUES))


def either(*draws: Draw) -> Draw:
    """Draw from one of these, each as often as the others."""
    return lambda random: random.choice(draws)(random)


def listed(draw: Draw, most: int) -> Draw:
    """Draw a list of up to `most` of something."""
    return lambda random: [draw(random) for _ in range(random.randrange(most + 1))]


def real_files(folder: str, *suffixes: str) -> list[bytes]:
    """Read the recorded files below ``shared/real/<folder>``, by suffix; none where they are absent."""
    root = REAL / folder
    files = sorted(path for path in root.rglob("*") if path.is_file()) if root.is_dir() else []
    return [_head(path) for path in files if not suffixes or path.name.lower().endswith(suffixes)]


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(LARGEST_SEED_BYTES)


def _edited(content: bytes, other: bytes, random: Random) -> bytes:
    """Return the file with one change."""
    kind = random.choice(_KINDS)
    start = int(random.random() * len(content))
    if kind == "number":
        return _with_other_number(content, start, _token(random))
    # Short pieces are the usual damage, long ones are drawn too.
    end = min(len(content), start + 1 + int(random.random() ** 2 * len(content) / 2))
    before, piece, after = content[:start], content[start:end], content[end:]
    if kind == "flip":
        parts = (before, bytes(byte ^ random.randint(1, 255) for byte in piece[:1]), piece[1:], after)
    elif kind in ("insert", "replace"):
        parts = (before, _token(random), piece if kind == "insert" else b"", after)
    elif kind == "splice":
        parts = (before, other[int(random.random() * len(other)) :][: len(piece) + 40], after)
    elif kind == "repeat":
        parts = (before, piece * random.randint(2, 31), after)
    else:
        parts = {"cut": (before,), "head": (piece, after), "drop": (before, after)}.get(
            kind, (after, piece, before)
        )
    return b"".join(parts)


def _token(random: Random) -> bytes:
    return random.choice(_TOKENS) if random.random() < 0.7 else random.randbytes(random.randrange(7))


def _with_other_number(content: bytes, start: int, token: bytes) -> bytes:
    """Replace the first number from `start` on."""
    found = _NUMBER.search(content, start)
    return content if found is None else content[: found.start()] + token + content[found.end() :]
