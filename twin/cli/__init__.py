"""The command line: a module a subject, in which each command is declared and done by one function.

:mod:`twin.cli.app` says which module holds which command, :mod:`twin.cli.exit_codes` with which code it ends.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from typing import NoReturn

from twin.cli.exit_codes import (
    EXIT_BUG,
    EXIT_INTERRUPTED,
    EXIT_MACHINE,
    EXIT_NO_READER,
    EXIT_OK,
    EXIT_TERMINATED,
    EXIT_USAGE,
    exit_code,
)
from twin.cli.journal import end, json_message, session, wants_json
from twin.cli.machine import refusal, watch_memory
from twin.cli.streams import OutputError, watch_streams

__all__ = ["main", "run"]

_INTERRUPTED = "{how}: the store shows the old state or the whole new one; run the command again to go on."
_BUG = "An error in twin itself ({kind}): please report it, with the lines above."


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `twin` and leave with its exit code."""
    try:
        _watch_sigterm()
        watch_streams()
        watch_memory()
        code = run(arguments)
        _leave_uninterrupted()
    except KeyboardInterrupt:  # while modules are loaded, or in the instant after the work
        _leave_uninterrupted()
        code = _interrupted()
    except Exception as error:
        as_json, refused = wants_json(_words(arguments)), refusal(error)
        if refused is None and not as_json:
            raise
        if refused is None:
            traceback.print_exc()
        code, sentence = refused or (EXIT_BUG, _BUG.format(kind=type(error).__name__))
        # What colours a sentence may be what there is no memory for.
        sys.stderr.write(json_message("error", sentence, code) if as_json else f"twin: {sentence}\n")
    if code in (EXIT_INTERRUPTED, EXIT_TERMINATED):
        _leave_at_once(code)
    sys.exit(code)


def _leave_at_once(code: int) -> NoReturn:
    """End the process without waiting for its threads.

    At its end Python joins the thread that fetches one page ahead, which a slow server can hold for minutes.
    Files and transactions were left by their ``with`` blocks on the way here.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OutputError):
            stream.flush()
    os._exit(code)


def _leave_uninterrupted() -> None:
    """Ignore Ctrl-C from here on.

    What was to be done is done and told. At its end Python gives SIGINT back to the system, which would kill
    the process and make an exit code of 130 out of a success. So with SIGTERM.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)


class _Terminated(KeyboardInterrupt):
    """SIGTERM, which is to end everything as Ctrl-C does."""

    came = False


def _watch_sigterm() -> None:
    """Let SIGTERM leave ``with`` blocks in order, unless whoever started twin wants it ignored."""

    def leave(_signal: int, _frame: object) -> NoReturn:
        # Kept too: what is between here and there may make another exception of it.
        _Terminated.came = True
        raise _Terminated

    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, leave)


def _interrupted() -> int:
    from twin.cli.output import error_line

    code = EXIT_TERMINATED if _Terminated.came else EXIT_INTERRUPTED
    error_line(_INTERRUPTED.format(how="Terminated" if _Terminated.came else "Interrupted"), code)
    return code


def run(arguments: Sequence[str] | None = None) -> int:
    """Run `twin` with the given arguments (default: the process's own) and return the exit code."""
    words = _words(arguments)
    with session(words):
        try:
            code = _run(words)
        except Exception as error:
            refused = refusal(error)
            if refused is None:
                end(EXIT_BUG, error)
            else:
                end(refused[0], refused[1])
            raise
        end(code)
    return code


def _words(arguments: Sequence[str] | None) -> Sequence[str]:
    return sys.argv[1:] if arguments is None else arguments


def _run(words: Sequence[str]) -> int:
    from typer.main import get_command

    from twin.cli.app import app
    from twin.cli.output import error_line
    from twin.cli.usage import UsageError, usage_sentence

    twin = get_command(app)
    try:
        code = twin.main(words, prog_name="twin", standalone_mode=False) or EXIT_OK
        sys.stdout.flush()
    except UsageError as error:
        sentence = usage_sentence(error, twin, words)
        if sentence:
            error_line(sentence, EXIT_USAGE)
        return EXIT_USAGE
    except KeyboardInterrupt:
        return _interrupted()
    except OutputError as error:
        if error.nobody_reads:
            return EXIT_NO_READER
        error_line(str(error), EXIT_MACHINE)
        return EXIT_MACHINE
    except Exception as error:
        code = exit_code(error)
        if code == EXIT_BUG:
            raise
        error_line(_with_option(error), code)
        return code
    return _interrupted() if code == EXIT_INTERRUPTED else code


def _with_option(error: Exception) -> str:
    """Return an error's sentence; where the library knows a cure but not the option for it, with that."""
    from nvdb.mirror import MassDeletionError

    if isinstance(error, MassDeletionError):
        return f"{str(error).removesuffix('.')} (--confirm-deletions)."
    return str(error)
