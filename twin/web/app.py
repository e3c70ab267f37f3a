"""A page's routes and files behind the guard."""

from __future__ import annotations

from collections.abc import Sequence
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.responses import FileResponse
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from twin.errors import TwinError
from twin.web.guard import Address, Guard, Outside
from twin.web.messages import PageError, on_fault, on_http_exception, on_page_error, on_twin_error
from twin.web.sessions import Sessions
from twin.web.signs import SIGN

if TYPE_CHECKING:
    import os

    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.types import Scope

SHARED = Path(__file__).parent / "static"
"""Files that every page uses: the map library."""
_TYPES = {
    ".css": "text/css",
    ".html": "text/html",
    ".js": "text/javascript",
    ".json": "application/json",
    ".map": "application/json",
    ".mjs": "text/javascript",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".txt": "text/plain",
    ".webp": "image/webp",
    ".woff2": "font/woff2",
}
"""What a file is, by its ending: the system's table may call a module plain text, which no browser runs."""


class _Files(StaticFiles):
    """Files of several folders under one address: the page's own first, then the shared ones."""

    def __init__(self, folders: Sequence[Path]) -> None:
        super().__init__(directory=folders[0], check_dir=False)
        self.all_directories = list(folders)

    def file_response(
        self,
        full_path: str | os.PathLike[str],
        stat_result: os.stat_result,
        scope: Scope,
        status_code: int = 200,
    ) -> Response:
        """Send a file with the type that its ending says."""
        answer = super().file_response(full_path, stat_result, scope, status_code)
        if isinstance(answer, FileResponse):
            kind = _TYPES.get(Path(full_path).suffix, "application/octet-stream")
            is_text = kind.startswith("text/")
            answer.headers["Content-Type"] = f"{kind}; charset=utf-8" if is_text else kind
        # The browser asks each time whether it has changed: after an upgrade no old module meets a new one.
        answer.headers["Cache-Control"] = "no-cache"
        return answer


def web_app(
    routes: Sequence[BaseRoute],
    folder: Path,
    *,
    name: str,
    sessions: Sessions,
    address: Address,
    outside: Outside | None = None,
) -> Starlette:
    """Put a page together.

    Parameters
    ----------
    routes : sequence of BaseRoute
        The page's own.
    folder : Path
        Its files, served under ``/static/``; ``index.html`` is the page itself. Signs are drawn under
        ``/sign/``.
    name : str
        Of the page, for its cookie.
    sessions : Sessions
    address : Address
        Where it will listen.
    outside : Outside, optional
        Other hosts that it may ask; none by default.
    """

    def index(_request: Request) -> Response:
        page = folder / "index.html"
        if not page.is_file():
            raise PageError(HTTPStatus.NOT_FOUND, "This twin was installed without its page.")
        return FileResponse(page, media_type="text/html", headers={"Cache-Control": "no-store"})

    files = Mount("/static", _Files([folder, SHARED]))
    handlers: dict[Any, Any] = {
        PageError: on_page_error,
        TwinError: on_twin_error,
        HTTPException: on_http_exception,
        Exception: on_fault,
    }
    guard = Middleware(Guard, sessions=sessions, address=address, outside=outside or Outside(), name=name)
    return Starlette(
        routes=[Route("/", index), files, SIGN, *routes], middleware=[guard], exception_handlers=handlers
    )
