"""The annotation page's routes."""

from __future__ import annotations

import datetime as dt
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
from starlette.concurrency import run_in_threadpool
from starlette.responses import Response
from starlette.routing import Route

from geoloc.locate.records import Kind
from twin.annotate.codes import search
from twin.annotate.files import OwnFiles, file_name
from twin.annotate.geometry import Geometry
from twin.annotate.marks import Book, Mark, Where
from twin.annotate.pictures import LostPictureError, PictureCache
from twin.annotate.proposals import Proposals, confirmed
from twin.annotate.recording import Recording
from twin.annotate.records import (
    CameraItem,
    CodeList,
    ConfirmRequest,
    MarkItem,
    MarkRequest,
    NameRequest,
    PictureRecord,
    RemoveRequest,
    SessionRecord,
    State,
    UndoRequest,
)
from twin.annotate.state import signs_of
from twin.drives.annotations.write_cvat import CvatTask
from twin.drives.frames.stamp_files import NO_STAMP
from twin.errors import TwinError
from twin.web.app import web_app
from twin.web.guard import Address
from twin.web.messages import PageError, answer_of, body_of, refusal
from twin.web.sessions import Sessions
from twin.words import Lang, SignNames, language_from, messages, say
from twin.words.table import Fact

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request

STATIC = Path(__file__).parent / "static"
_MAX_NAME, _MAX_CODES = 80, 80
_CODES = re.compile(r"[\w.]{1,20}(;[\w.]{1,20}){0,7}")
_SMALLEST_BOX_PX = 2.0


@dataclass(frozen=True, slots=True)
class AnnotateOptions:
    """How the page is served.

    Attributes
    ----------
    by : str
        Who annotates; kept in the files.
    lang : Lang or None
        None for the browser's.
    names : SignNames
        Of sign codes, to search in.
    codes : frozenset of str
        All sign codes that there are: another is asked about before it is kept. Empty: none is asked about.
    """

    by: str = ""
    lang: Lang | None = None
    names: SignNames = field(default_factory=dict)
    codes: frozenset[str] = frozenset()


class Refusal(Exception):  # noqa: N818 - it is no error
    """What the page asked for and does not get: a message of the table, said in the browser's language."""

    def __init__(self, key: str, status: HTTPStatus = HTTPStatus.CONFLICT, **facts: Fact) -> None:
        super().__init__(key)
        self.key = key
        self.status = status
        self.facts = facts


def annotate_app(recording: Recording, options: AnnotateOptions, address: Address) -> tuple[Starlette, str]:
    """Make the page's server for a drive.

    Returns
    -------
    Starlette, str
        The application, and the token that opens it.

    Raises
    ------
    DriveError
        A file that the page itself has written is damaged.
    """
    sessions = Sessions(options.by)
    page = _Page(recording, options)
    app = web_app(page.routes(), STATIC, name="annotate", sessions=sessions, address=address)
    app.add_exception_handler(Refusal, page.refused)
    return app, sessions.token


class _Page:
    """What the routes share."""

    def __init__(self, recording: Recording, options: AnnotateOptions) -> None:
        self.recording = recording
        self.options = options
        self.by = "".join(letter for letter in options.by if letter.isprintable())[:_MAX_NAME]
        self.files = OwnFiles(
            recording.root, {camera: _task(recording, camera, self.by) for camera in recording.pictures}
        )
        self.book = Book(self.files.read(), recording.foreign.object.tolist())
        geometry = Geometry(recording.rig, recording.trajectory, recording.frames, recording.epoch_ns)
        self.proposals = Proposals(geometry, tuple(recording.pictures), recording.foreign)
        self.pictures = PictureCache(recording)
        self.lock = Lock()

    def routes(self) -> list[Route]:
        """Return the page's addresses."""
        return [
            Route("/api/session", self.session),
            Route("/api/picture/{camera}/{frame:int}", self.picture),
            Route("/frame/{camera}/{frame:int}.jpg", self.frame),
            Route("/api/codes", self.codes),
            Route("/api/mark", self.mark, methods=["POST"]),
            Route("/api/confirm", self.confirm, methods=["POST"]),
            Route("/api/remove", self.remove, methods=["POST"]),
            Route("/api/name", self.name, methods=["POST"]),
            Route("/api/undo", self.undo, methods=["POST"]),
        ]

    # -- looking -------------------------------------------------------------------------------------------

    def session(self, request: Request) -> Response:
        """Tell what the page needs once."""
        lang = self.lang(request)
        with self.lock:
            state = self.state()
        record = SessionRecord(
            drive=self.recording.name,
            by=self.by,
            lang=lang,
            is_complete=self.recording.is_complete,
            notices=list(self.recording.notices),
            cameras=[_camera_item(self.recording, camera) for camera in self.recording.pictures],
            state=state,
            messages=messages(lang, "annotate."),
        )
        return answer_of(record)

    def picture(self, request: Request) -> Response:
        """Tell what is marked and proposed in a picture."""
        camera, frame = self.asked(request.path_params["camera"], request.path_params["frame"])
        with self.lock:
            page = self.book.page
            marks = [
                MarkItem(where.object, where.kind, list(mark.place_px), mark.is_measured)
                for where, mark in page.marks.items()
                if (where.camera, where.frame) == (camera, frame)
            ]
            proposals = self.proposals.in_picture(page, camera, frame)
        return answer_of(PictureRecord(camera, frame, [*marks, *self.foreign(camera, frame)], proposals))

    def frame(self, request: Request) -> Response:
        """Send a picture; the guard says that nobody may store it."""
        camera, frame = self.asked(request.path_params["camera"], request.path_params["frame"])
        try:
            return Response(self.pictures.jpeg(camera, frame), media_type="image/jpeg")
        except LostPictureError as error:
            raise PageError(HTTPStatus.CONFLICT, str(error)) from error

    def codes(self, request: Request) -> Response:
        """Search sign codes by code or name."""
        return answer_of(CodeList(search(self.options.names, request.query_params.get("q", "")[:_MAX_NAME])))

    # -- marking -------------------------------------------------------------------------------------------

    async def mark(self, request: Request) -> Response:
        """Keep a foot or a box."""
        asked = await body_of(request, MarkRequest)
        camera, frame = self.asked(asked.camera, asked.frame)
        mark = self.checked(asked)

        def change() -> str:
            name = asked.object or self.book.new_object()
            if asked.object:
                self.known(asked.object)
            if any(one.object == name and one.kind is asked.kind for one in self.foreign(camera, frame)):
                raise Refusal("refused.marked_elsewhere", sign=name)
            codes = _checked_codes(asked.codes) or self.foreign_codes(name)
            self.book.mark({Where(name, camera, frame, asked.kind): mark}, self.by, codes)
            return name

        return await run_in_threadpool(self.changed, change)

    async def confirm(self, request: Request) -> Response:
        """Keep that a sign was seen where it is proposed."""
        asked = await body_of(request, ConfirmRequest)
        camera, frame = self.asked(asked.camera, asked.frame)

        def change() -> str:
            self.known(asked.object)
            proposed = self.proposals.in_picture(self.book.page, camera, frame)
            marks = confirmed([item for item in proposed if item.object == asked.object], camera, frame)
            if not marks:
                raise Refusal("refused.not_proposed", sign=asked.object)
            self.book.mark(marks, self.by)
            return asked.object

        return await run_in_threadpool(self.changed, change)

    async def remove(self, request: Request) -> Response:
        """Take marks away."""
        asked = await body_of(request, RemoveRequest)

        def change() -> str:
            gone = [
                where
                for where in self.book.page.marks
                if where.object == asked.object
                and (not asked.camera or (where.camera, where.frame) == (asked.camera, asked.frame))
            ]
            if not gone:
                raise Refusal("refused.not_marked", sign=asked.object)
            self.book.remove(gone)
            return asked.object

        return await run_in_threadpool(self.changed, change)

    async def name(self, request: Request) -> Response:
        """Keep what stands on a pole."""
        asked = await body_of(request, NameRequest)

        def change() -> str:
            if asked.object not in self.book.page.signs:
                raise Refusal("refused.mark_first", sign=asked.object)
            codes = _checked_codes(asked.codes)
            if not asked.is_meant:
                self.doubt(codes)
            self.book.name(asked.object, codes)
            return asked.object

        return await run_in_threadpool(self.changed, change)

    async def undo(self, request: Request) -> Response:
        """Take the last change back."""
        await body_of(request, UndoRequest)

        def change() -> str:
            if not self.book.can_undo:
                raise Refusal("refused.nothing_to_undo")
            self.book.undo()
            return ""

        return await run_in_threadpool(self.changed, change)

    # -- what they share -----------------------------------------------------------------------------------

    def changed(self, change: Callable[[], str]) -> Response:
        """Change the marks and write them; what cannot be written did not happen."""
        with self.lock:
            kept = self.book.at()
            before = self.book.page
            name = change()
            try:
                copies = self.files.save(before, self.book.page, dt.datetime.now(dt.UTC))
            except TwinError:
                self.book.back_to(kept)
                raise
            return answer_of(self.state(name, copies))

    def lang(self, request: Request) -> Lang:
        """The language of whoever asks."""
        return self.options.lang or language_from(request.headers.get("accept-language", ""))

    def refused(self, request: Request, error: Exception) -> Response:
        """Say why not."""
        assert isinstance(error, Refusal)  # noqa: S101 - registered for nothing else
        return refusal(error.status, say(self.lang(request), error.key, **error.facts))

    def state(self, name: str = "", copies: list[str] | None = None) -> State:
        """All signs as they are now."""
        placed = self.proposals.of(self.book.page)
        signs = signs_of(self.book.page, placed, self.recording.foreign, self.options.names)
        return State(name, signs, self.book.can_undo, copies or [])

    def asked(self, camera: str, frame: int) -> tuple[str, int]:
        """Return a camera and a frame that there are."""
        if camera not in self.recording.pictures or not np.isin(frame, self.recording.frames[camera]):
            raise Refusal("refused.no_picture", HTTPStatus.NOT_FOUND, frame=frame, camera=camera)
        return camera, frame

    def known(self, name: str) -> None:
        """Refuse a sign that nobody has marked."""
        if name not in self.book.page.signs and name not in self.recording.foreign.object:
            raise Refusal("refused.no_sign", sign=name)

    def doubt(self, codes: str) -> None:
        """Ask whether codes that the list does not have are meant."""
        unknown = [code for code in codes.split(";") if code and code not in self.options.codes]
        if self.options.codes and unknown:
            raise Refusal("refused.unknown_code", HTTPStatus.UNPROCESSABLE_ENTITY, codes=", ".join(unknown))

    def checked(self, asked: MarkRequest) -> Mark:
        """Return what was clicked or drawn, if it is in the picture."""
        model = self.recording.rig.camera(asked.camera).model
        place = np.array(asked.place_px, dtype=np.float64)
        wanted = 2 if asked.kind is Kind.FOOT else 4
        sizes = np.tile([model.width_px, model.height_px], 2)[:wanted]
        if place.size != wanted or not np.all((place >= -0.5) & (place <= sizes - 0.5)):
            raise Refusal("refused.outside", HTTPStatus.BAD_REQUEST)
        if wanted == 4 and np.any(place[2:] - place[:2] < _SMALLEST_BOX_PX):
            raise Refusal("refused.no_box", HTTPStatus.BAD_REQUEST)
        return Mark(tuple(np.round(place, 2).tolist()))

    def foreign(self, camera: str, frame: int) -> list[MarkItem]:
        """Marks of other tools in a picture."""
        of = self.recording.foreign
        rows = np.flatnonzero((of.camera == camera) & (of.frame == frame))
        return [
            MarkItem(
                str(of.object[k]),
                Kind(str(of.kind[k])),
                (of.box_px[k] if of.kind[k] == Kind.BOX else of.pixel_px[k]).tolist(),
                bool(of.is_measured[k]),
                str(of.file[k]),
            )
            for k in rows.tolist()
        ]

    def foreign_codes(self, name: str) -> str:
        """What another tool's file says of a sign."""
        of = self.recording.foreign
        return next((str(code) for code in of.skiltnummer[of.object == name] if code), "")


def _checked_codes(codes: str) -> str:
    text = ";".join(part.strip() for part in codes.split(";") if part.strip())
    if text and (len(text) > _MAX_CODES or not _CODES.fullmatch(text)):
        raise Refusal("refused.no_code", HTTPStatus.BAD_REQUEST, code=text[:_MAX_CODES])
    return text


def _task(recording: Recording, camera: str, by: str) -> CvatTask:
    model, where = recording.rig.camera(camera).model, recording.pictures[camera].where
    frames = recording.frames[camera]
    return CvatTask(
        name=f"{recording.name} {camera}",
        source=where,
        width_px=model.width_px,
        height_px=model.height_px,
        last_frame=int(frames[-1]) if frames.size else 0,
        made=dt.datetime.now(dt.UTC),
        owner=by,
    )


def _camera_item(recording: Recording, camera: str) -> CameraItem:
    model, frames = recording.rig.camera(camera).model, recording.frames[camera]
    stamps = recording.epoch_ns.get(camera, np.full(frames.size, NO_STAMP))
    known = [of[of != NO_STAMP] for of in recording.epoch_ns.values()]
    start = min((int(of.min()) for of in known if of.size), default=0)
    moments = np.where(stamps == NO_STAMP, -1.0, (stamps - start) * 1e-9)
    return CameraItem(
        camera, model.width_px, model.height_px, frames.tolist(), moments.tolist(), file_name(camera)
    )
