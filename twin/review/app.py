"""The review page's routes."""

from __future__ import annotations

import datetime as dt
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import msgspec
import sqlalchemy as sa
from starlette.concurrency import run_in_threadpool
from starlette.responses import FileResponse, Response
from starlette.routing import Route

from twin.decisions.answers import Author, SeenOtherwiseError, answer, answers_of, undo_answer
from twin.decisions.evidence import Ask
from twin.decisions.log import TWIN
from twin.decisions.opinions import agreement, opinions_of
from twin.errors import ConfigError, RefusedError
from twin.evidence import crop_file
from twin.review.drives import Drives
from twin.review.finding import finding_record
from twin.review.index import Eyes, Findings, Index, chunks, counts, in_queue, states
from twin.review.records import (
    AgreementCount,
    AnswerItem,
    AnswerList,
    AnswerRecord,
    AnswerRequest,
    DriveItem,
    FindingList,
    Points,
    Queue,
    ReviewerRecord,
    ReviewerRequest,
    SessionRecord,
    State,
    UndoRecord,
    UndoRequest,
)
from twin.review.shapes import tracks_of
from twin.store import schema
from twin.store.store import Snapshot, Store
from twin.web import base_map
from twin.web.app import web_app
from twin.web.guard import Address, Outside
from twin.web.messages import PageError, answer_of, body_of
from twin.web.sessions import Sessions, session_of
from twin.words import Lang, decision_title, language_from, messages, say
from twin.words.table import Fact

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request

STATIC = Path(__file__).parent / "static"
MAX_LIST = 500
MAX_COMMENT = 2000
MAX_NAME = 80

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class ReviewOptions:
    """How the page is served.

    Attributes
    ----------
    person : str
        Who reviews; "" to be asked in the page.
    blind : bool
        Answers are opinions, and others' do not show.
    read_only : bool
        Nothing can be answered.
    base_map : bool
        Whether the page may ask Kartverket for map tiles.
    lang : Lang or None
        None for the browser's.
    """

    person: str = ""
    blind: bool = False
    read_only: bool = False
    base_map: bool = False
    lang: Lang | None = None


def review_app(store: Store, options: ReviewOptions, address: Address) -> tuple[Starlette, str]:
    """Make the page's server for a store.

    Parameters
    ----------
    store : Store
        Matched; it stays open as long as the server runs.
    options : ReviewOptions
    address : Address
        Where it will listen.

    Returns
    -------
    Starlette, str
        The application, and the token that opens it.

    Raises
    ------
    StoreError
        Nothing was matched yet.
    """
    # Of findings older than the drives the page itself says so, and shows what there is.
    with suppress(RefusedError):
        store.matched()
    sessions = Sessions(options.person)
    page = _Page(store, options)
    outside = Outside((base_map.HOST,) if options.base_map else ())
    app = web_app(page.routes(), STATIC, name="review", sessions=sessions, address=address, outside=outside)
    return app, sessions.token


@dataclass(slots=True)
class _Page:
    """What the routes share."""

    store: Store
    options: ReviewOptions
    findings: Findings = field(init=False)
    drives: Drives = field(default_factory=Drives)

    def __post_init__(self) -> None:
        self.findings = Findings(self.store)
        with self.store.snapshot() as view:
            self.findings.index(view)

    def routes(self) -> list[Route]:
        """Return the page's addresses."""
        return [
            Route("/api/session", self.session),
            Route("/api/session/answers", self.answers),
            Route("/api/findings", self.list),
            Route("/api/points", self.points),
            Route("/api/tracks", self.tracks),
            Route("/api/finding/{change_id}", self.finding),
            Route("/api/reviewer", self.reviewer, methods=["POST"]),
            Route("/api/answer", self.answer, methods=["POST"]),
            Route("/api/undo", self.undo, methods=["POST"]),
            Route("/crop/{sha256}.webp", self.crop),
        ]

    # -- looking -------------------------------------------------------------------------------------------

    def session(self, request: Request) -> Response:
        """Tell what the page needs once."""
        eyes = self.eyes(request)
        with self.store.snapshot() as view:
            index = self.findings.index(view)
            known = states(view.rows, self.findings.decided(view), eyes)
            record = SessionRecord(
                store=self.store.name,
                reviewer=eyes.reviewer,
                lang=eyes.lang,
                read_only=self.options.read_only or self.store.read_only is not None,
                blind=self.options.blind,
                notice=self.notice(view, eyes.lang),
                reviewers=_reviewers(view.rows),
                counts=counts(index, known),
                disagreements=sum(state is State.DISAGREEMENT for state in known.values()),
                agreement={
                    verdict: AgreementCount(one.n, one.n_agreed)
                    for verdict, one in agreement(opinions_of(view.rows)).items()
                },
                kommuner=sorted({kommune for place in index.place for kommune in place.kommuner}),
                drives=_drives(view),
                roads=sorted({place.road for place in index.place if place.road}),
                base_map=base_map.BASE_MAP if self.options.base_map else None,
                bounds=_bounds(index),
                messages=messages(eyes.lang, "page."),
            )
        return answer_of(record)

    def list(self, request: Request) -> Response:
        """Return a piece of a list of findings."""
        queue = _queue(request)
        offset, limit = _number(request, "offset", 0), min(_number(request, "limit", 50), MAX_LIST)
        with self.store.snapshot() as view:
            index = self.findings.index(view)
            known = states(view.rows, self.findings.decided(view), self.eyes(request))
        rows = [
            row
            for row in index.ordered(queue)
            if in_queue(known.get(index.change_id[row], State.OPEN), queue.state)
        ]
        items = [
            index.item(row, known.get(index.change_id[row], State.OPEN))
            for row in rows[offset : offset + limit]
        ]
        return answer_of(FindingList(len(rows), items))

    def points(self, request: Request) -> Response:
        """Return all findings of a list for a map; whatever their state, unless one is named."""
        queue = _queue(request)
        with self.store.snapshot() as view:
            index = self.findings.index(view)
            known = states(view.rows, self.findings.decided(view), self.eyes(request))
        found = [(row, known.get(index.change_id[row], State.OPEN)) for row in index.ordered(queue)]
        found = [(row, state) for row, state in found if in_queue(state, queue.state or "all")]
        return answer_of(
            Points(
                [index.change_id[row] for row, _ in found],
                [float(index.lon[row]) for row, _ in found],
                [float(index.lat[row]) for row, _ in found],
                [index.verdict[row] for row, _ in found],
                [state for _, state in found],
            )
        )

    def tracks(self, _request: Request) -> Response:
        """Return where the drives went, for the map of all findings."""
        with self.store.snapshot() as view:
            return answer_of(tracks_of(view))

    def finding(self, request: Request) -> Response:
        """Return everything about one finding."""
        eyes, change_id = self.eyes(request), request.path_params["change_id"]
        with self.store.snapshot() as view:
            index, notice = self.findings.index(view), self.notice(view, eyes.lang)
            record = finding_record(view, change_id, index, self.drives, eyes, notice)
        if record is None:
            raise PageError(HTTPStatus.NOT_FOUND, say(eyes.lang, "review.no_finding"))
        return answer_of(record)

    def answers(self, request: Request) -> Response:
        """Return what this session answered."""
        who = session_of(request)
        with self.store.snapshot() as view:
            index = self.findings.index(view)
            entries = answers_of(view.rows, Author(who.person, who.id))
        items = []
        for entry in entries:
            row = index.row.get(entry.change_id)
            title = "" if row is None else index.title[row]
            items.append(AnswerItem(entry.change_id, entry.decision, entry.reason, entry.at, title))
        return answer_of(AnswerList(items))

    def crop(self, request: Request) -> Response:
        """Send a picture that the store has by this hash; its bytes never change."""
        try:
            path = crop_file(self.store, request.path_params["sha256"])
        except ConfigError as error:
            raise PageError(HTTPStatus.NOT_FOUND, "The store has no such picture.") from error
        if not path.is_file():
            raise PageError(HTTPStatus.NOT_FOUND, "The file of this picture is gone.")
        kept = {"Cache-Control": "private, max-age=86400, immutable"}
        return FileResponse(path, media_type="image/webp", headers=kept)

    # -- answering -----------------------------------------------------------------------------------------

    async def reviewer(self, request: Request) -> Response:
        """Keep who sits at this browser."""
        asked = await body_of(request, ReviewerRequest)
        name = " ".join(asked.name.split())
        if not name or len(name) > MAX_NAME or not name.isprintable() or name == TWIN:
            raise PageError(HTTPStatus.BAD_REQUEST, self.say(request, "review.bad_name", n=MAX_NAME))
        who = session_of(request)
        # Another tab of the same browser may have asked too: what it answers is under the first name.
        if who.person not in ("", name) and not asked.of_kept_answers:
            raise PageError(HTTPStatus.CONFLICT, self.say(request, "review.named_already", by=who.person))
        who.person = name
        return answer_of(ReviewerRecord(name))

    async def answer(self, request: Request) -> Response:
        """Keep an answer."""
        asked = await body_of(request, AnswerRequest)
        if len(asked.comment) > MAX_COMMENT:
            raise PageError(HTTPStatus.BAD_REQUEST, self.say(request, "review.long_comment", n=MAX_COMMENT))
        eyes, author = self.eyes(request), self.author(request)
        try:
            return answer_of(await run_in_threadpool(self._answer, asked, eyes, author))
        except SeenOtherwiseError as error:
            raise PageError(HTTPStatus.CONFLICT, _seen_otherwise(error, eyes.lang)) from error

    def _answer(self, asked: AnswerRequest, eyes: Eyes, author: Author) -> AnswerRecord:
        done = answer(
            self.store,
            asked.change_id,
            asked.answer,
            author,
            seen=asked.seen_revision,
            reason=asked.comment.strip(),
            temporary=asked.temporary,
            blind=self.options.blind,
        )
        with self.store.snapshot() as view:
            index = self.findings.index(view)
            decided = self.findings.decided(view)
            state = states(view.rows, decided, eyes, (asked.change_id,)).get(asked.change_id, State.OPEN)
            rows = _after(index.ordered(asked.queue), index.row.get(asked.change_id))
            for some in chunks(rows):
                ids = [index.change_id[row] for row in some]
                known = states(view.rows, decided, eyes, ids)
                left = next((key for key in ids if in_queue(known.get(key, State.OPEN), State.OPEN)), None)
                if left is not None:
                    return AnswerRecord(asked.change_id, state, done.entry_id, left)
        return AnswerRecord(asked.change_id, state, done.entry_id, None)

    async def undo(self, request: Request) -> Response:
        """Take this reviewer's last answer of this session back."""
        await body_of(request, UndoRequest)
        change_id = await run_in_threadpool(undo_answer, self.store, self.author(request))
        if change_id is None:
            raise PageError(HTTPStatus.CONFLICT, self.say(request, "review.nothing_left"))
        return answer_of(UndoRecord(change_id))

    def author(self, request: Request) -> Author:
        """Return who asks, and by which key."""
        who = session_of(request)
        if self.options.read_only:
            raise PageError(HTTPStatus.CONFLICT, self.say(request, "review.read_only"))
        if self.store.read_only is not None:
            raise PageError(HTTPStatus.CONFLICT, self.say(request, "review.store_read_only"))
        if not who.person:
            raise PageError(HTTPStatus.CONFLICT, self.say(request, "review.ask_name"))
        key = request.headers.get("idempotency-key", "")
        return Author(who.person, who.id, key[:MAX_NAME] or None)

    # -- what holds for all --------------------------------------------------------------------------------

    def eyes(self, request: Request) -> Eyes:
        """Return what this browser's reviewer may see, and in which language."""
        accepted = request.headers.get("accept-language", "")
        lang = self.options.lang or language_from(accepted)
        return Eyes(session_of(request).person, self.options.blind, lang)

    def say(self, request: Request, key: str, **facts: Fact) -> str:
        """Say something in the browser's language."""
        return say(self.eyes(request).lang, key, **facts)

    def notice(self, view: Snapshot, lang: Lang) -> str | None:
        """Say why nothing can be answered now."""
        if self.options.read_only:
            return say(lang, "review.read_only")
        if self.store.read_only is not None:
            return say(lang, "review.store_read_only")
        try:
            view.matched()
        except RefusedError:
            return say(lang, "review.stale")
        return None


def _seen_otherwise(error: SeenOtherwiseError, lang: Lang) -> str:
    """Say why an answer was not kept."""
    if error.last is None:
        return say(lang, "review.changed")
    decision = decision_title(error.last.decision, lang)
    return say(lang, "review.decided_since", by=error.last.by, decision=decision)


def _after(rows: list[int], row: int | None) -> list[int]:
    """The rows of a queue behind one, then those before it."""
    if row not in rows:
        return rows
    at = rows.index(row)
    return rows[at + 1 :] + rows[:at]


def _queue(request: Request) -> Queue:
    asked = {name: value for name, value in request.query_params.items() if name not in ("offset", "limit")}
    try:
        return msgspec.convert({k: v for k, v in asked.items() if v}, Queue)
    except msgspec.ValidationError as error:
        raise PageError(HTTPStatus.BAD_REQUEST, f"The list cannot be made: {error}.") from error


def _number(request: Request, name: str, default: int) -> int:
    text = request.query_params.get(name, str(default))
    if not text.isascii() or not text.isdigit() or len(text) > 9:
        raise PageError(HTTPStatus.BAD_REQUEST, f"{name} is a whole number of 0 or more.")
    return int(text)


def _reviewers(ask: Ask) -> list[str]:
    """Return who has decided before, for the choice of a name."""
    log = schema.decision_log.c
    rows = ask(sa.select(log.by).where(log.by != TWIN).distinct().order_by(log.by))
    return [row["by"] for row in rows if " and " not in row["by"]]


def _drives(view: Snapshot) -> list[DriveItem]:
    drive = schema.drive.c
    rows = view.rows(sa.select(drive.drive_id, drive.name, drive.started_ns).order_by(drive.started_ns))
    return [DriveItem(row["drive_id"], row["name"], _day(row["started_ns"])) for row in rows]


def _day(epoch_ns: int) -> str:
    return dt.datetime.fromtimestamp(epoch_ns / 1e9, tz=dt.UTC).date().isoformat()


def _bounds(index: Index) -> tuple[float, float, float, float] | None:
    if not index.change_id:
        return None
    lon, lat = index.lon, index.lat
    return float(lon.min()), float(lat.min()), float(lon.max()), float(lat.max())
