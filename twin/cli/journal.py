"""How much `twin` says besides its data, in which form, and the log file that is kept of it.

Tables and documents go to standard output; progress, notes, warnings and errors to standard error. With
``--json`` each line of the latter is a JSON object with one key: ``error`` (an object with ``code``, ``kind``
and ``message``), ``warning`` or ``note`` (a sentence each).
"""

from __future__ import annotations

import datetime as dt
import json
import logging
import os
import re
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path

from twin.cli.exit_codes import kind_of
from twin.errors import ConfigError, FileError

PASSWORD = "TWIN_SKRIV_PASSWORD"  # noqa: S105  (the name of a variable)
_log = logging.getLogger("twin.cli")
_log.addHandler(logging.NullHandler())
_LOGGED = ("nvdb", "twin")


@dataclass(slots=True)
class Manner:
    """How the command that runs now talks.

    Attributes
    ----------
    quiet : bool
        Only what was asked for, changes, warnings and errors.
    verbose : bool
        Also what is done when, and what is asked of NVDB.
    as_json : bool
        Messages are JSON objects.
    log_file : Path or None
        As ``--log-file`` names it.
    command : str
        ``sync-nvdb``; "" before it is known.
    began_s : float
        Of :func:`time.monotonic`.
    """

    quiet: bool = False
    verbose: bool = False
    as_json: bool = False
    log_file: Path | None = None
    command: str = ""
    began_s: float = 0.0

    def become(self, other: Manner) -> None:
        """Take over all that another says."""
        for field in fields(Manner):
            setattr(self, field.name, getattr(other, field.name))


manner = Manner()


class LogLine(logging.Formatter):
    """One line of a log file: a JSON object.

    Its keys: ``time`` (UTC, ISO 8601 to the millisecond), ``level`` (debug, info, warning, error),
    ``command``, ``process`` (its number), ``what`` (a sentence), and where they apply ``exit_code``,
    ``seconds`` and ``traceback``.
    """

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, without its end."""
        line: dict[str, object] = {
            "time": _utc(record.created),
            "level": record.levelname.lower(),
            "command": manner.command,
            "process": record.process,
            "what": without_secrets(record.getMessage()),
        }
        for name in ("exit_code", "seconds"):
            if name in record.__dict__:
                line[name] = record.__dict__[name]
        if record.exc_info:
            line["traceback"] = without_secrets("".join(traceback.format_exception(*record.exc_info)))
        return json.dumps(line, ensure_ascii=False)


class _LogFile(logging.FileHandler):
    """Appends; where the disk takes no more it says so once, and the work goes on."""

    def handleError(self, _record: logging.LogRecord) -> None:
        error = sys.exc_info()[1]
        for name in _LOGGED:
            logging.getLogger(name).removeHandler(self)
        stream, self.stream = self.stream, None
        with suppress(OSError):
            if stream is not None:
                stream.close()
        why = getattr(error, "strerror", None) or error
        say("warning", f"The log file {self.baseFilename} takes no more ({why}): the work goes on without.")


class _OfNvdb(logging.Handler):
    """Shows on stderr what the client of NVDB's APIs tells: retries; and with ``--verbose`` each request."""

    def emit(self, record: logging.LogRecord) -> None:
        """Show one record."""
        if not record.name.startswith("nvdb.replay"):
            say("note", record.getMessage(), logged=True)


def _utc(seconds: float) -> str:
    instant = dt.datetime.fromtimestamp(seconds, tz=dt.UTC)
    return instant.isoformat(timespec="milliseconds").replace("+00:00", "Z")


_USER = re.compile(r"(?<=://)(?!USER@)[^/\s@]+@")
_TOKEN = re.compile(
    r"([?&;][\w.-]*(?:token|password|passord|secret|signature|key|code|state|auth)[\w.-]*=)[^&\s;'\")]+", re.I
)


def without_secrets(text: str) -> str:
    """Return a text without users and passwords in addresses, tokens in queries, and API Skriv's password."""
    password = os.environ.get(PASSWORD)
    if password:
        text = text.replace(password, "…")
    return _TOKEN.sub(r"\1…", _USER.sub("…@", text))


def wants_json(arguments: Sequence[str]) -> bool:
    """Whether messages are to be JSON, also where the arguments cannot be understood."""
    return "--json" in arguments


@contextmanager
def session(arguments: Sequence[str]) -> Iterator[None]:
    """Hold the manner of one run of `twin`; what :func:`begin` opens is closed at its end."""
    manner.become(Manner(as_json=wants_json(arguments), began_s=time.monotonic()))
    try:
        yield
    finally:
        for name in _LOGGED:
            logger = logging.getLogger(name)
            logger.setLevel(logging.NOTSET)
            for handler in [one for one in logger.handlers if isinstance(one, _LogFile | _OfNvdb)]:
                logger.removeHandler(handler)
                handler.close()


def set_manner(*, quiet: bool, verbose: bool, log_file: Path | None) -> None:
    """Take the options that stand before the command."""
    if quiet and verbose:
        raise ConfigError("--quiet and --verbose contradict each other: give one of them.")
    manner.quiet, manner.verbose, manner.log_file = quiet, verbose, log_file


def begin(command: str, log_file: Path | None) -> None:
    """Open the log file, if there is to be one, and listen to the client of NVDB.

    Raises
    ------
    FileError
        The log file cannot be written.
    """
    manner.command = command
    level = logging.DEBUG if manner.verbose else logging.INFO
    for name in _LOGGED:
        logging.getLogger(name).setLevel(level)
    if not (manner.quiet or manner.as_json) or manner.verbose:
        logging.getLogger("nvdb").addHandler(_OfNvdb())
    if log_file is None:
        return
    try:
        handler = _LogFile(log_file, encoding="utf-8")
    except OSError as error:
        raise FileError(
            f"The log file {log_file} cannot be written ({error.strerror}): name a file in a folder that is "
            "there and that this user may write to."
        ) from error
    handler.setFormatter(LogLine())
    for name in _LOGGED:
        logging.getLogger(name).addHandler(handler)
    from twin import __version__

    _log.info("began, twin %s", __version__)


def end(code: int, why: str | BaseException | None = None) -> None:
    """Note in the log file that the command has ended; and why, where nothing has said so before."""
    if isinstance(why, BaseException):
        _log.error("twin itself failed: %s", type(why).__name__, extra={"exit_code": code}, exc_info=why)
    elif why is not None:
        _log.error("%s", why, extra={"exit_code": code})
    seconds = round(time.monotonic() - manner.began_s, 3)
    _log.info("ended", extra={"exit_code": code, "seconds": seconds})


_LEVELS = {"error": logging.ERROR, "warning": logging.WARNING, "note": logging.INFO, "step": logging.INFO}


def say(kind: str, text: str, *, code: int | None = None, logged: bool = False) -> None:
    """Print one message on stderr in the manner that was asked for, and keep it in the log.

    Parameters
    ----------
    kind : {"error", "warning", "note", "step"}
        A note is not printed with ``--quiet``; a step, which says what is being done, only with
        ``--verbose``.
    text : str
    code : int, optional
        The exit code that an error leads to.
    logged : bool
        Whether the log file has it already.
    """
    text = without_secrets(text)
    if not logged:
        _log.log(_LEVELS[kind], "%s", text, extra={} if code is None else {"exit_code": code})
    if kind == "note" and manner.quiet:
        return
    if kind == "step" and not manner.verbose:
        return
    if manner.as_json:
        sys.stderr.write(json_message("note" if kind == "step" else kind, text, code))
        return
    from rich.markup import escape

    from twin.cli.output import console

    since = f"{time.monotonic() - manner.began_s:8.3f} s  " if manner.verbose else ""
    mark = {"error": "[bold red]twin:[/] ", "warning": "[yellow]warning:[/] "}.get(kind, "")
    console(stderr=True).print(f"{since}{mark}{escape(text)}", soft_wrap=True)


def json_message(kind: str, text: str, code: int | None) -> str:
    """Return a message as a line of JSON."""
    told: object = text
    if code is not None:
        told = {"code": code, "kind": kind_of(code), "message": text}
    line = json.dumps({kind: told}, ensure_ascii=False)
    # A file's name may be no text at all, on any stream.
    return line.encode("utf-8", errors="replace").decode() + "\n"
