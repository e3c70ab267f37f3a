"""What a test asks of the command line, and what it gets back."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Answer:
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output as one JSON document."""
        return json.loads(self.out)

    @property
    def error(self) -> Any:
        """What the last line of standard error says is wrong, of a command with ``--json``."""
        return json.loads(self.err.splitlines()[-1])["error"]


Twin = Callable[..., Answer]
"""The fixture `twin`: the command line, run in this process."""
