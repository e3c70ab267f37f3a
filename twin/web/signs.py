"""The sign faces that every page shows: drawn by code."""

from __future__ import annotations

from typing import TYPE_CHECKING

from starlette.responses import Response
from starlette.routing import Route

from twin.drawings import svg

if TYPE_CHECKING:
    from starlette.requests import Request

_MAX_LETTERS = 80


def sign(request: Request) -> Response:
    """Draw a sign: ``/sign/362.50.svg``, with the words of a board as ``?text=``."""
    code, text = request.path_params["code"], request.query_params.get("text", "")
    return Response(
        svg(code[:_MAX_LETTERS], text[:_MAX_LETTERS]),
        media_type="image/svg+xml",
        headers={"Cache-Control": "private, max-age=3600"},
    )


SIGN = Route("/sign/{code}.svg", sign)
"""Its address in a page."""
