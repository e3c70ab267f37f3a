"""How the help shows flags."""

from __future__ import annotations

from typing import Any


def without_type_of_flags(parameters: list[Any]) -> list[Any]:
    """Take ``<bool>`` from the help of flags: who reads it would type a value."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    return parameters
