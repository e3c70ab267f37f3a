"""The command line: a module a subject, in which each command is declared and done by one function.

:mod:`twin.cli.app` says which module holds which command, :mod:`twin.cli.exit_codes` with which code it ends.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NoReturn

from twin.cli.exit_codes import (
    EXIT_BUG,
    EXIT_INTERRUPTED,
    EXIT_MACHINE,
    EXIT_NO_READER,
    EXIT_OK,
    EXIT_USAGE,
    exit_code,
)
from twin.cli.machine import refusal, watch_memory
from twin.cli.streams import OutputError, watch_streams

__all__ = ["main", "run"]

_INTERRUPTED = (
    "Interrupted: the store shows the old state or the whole new one; run the command again to go on."
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `twin` and leave with its exit code."""
    try:
        watch_streams()
        watch_memory()
        code = run(arguments)
        _leave_uninterrupted()
    except KeyboardInterrupt:  # while modules are loaded, or in the instant after the work
        _leave_uninterrupted()
        code = _interrupted()
    except Exception as error:
        refused = refusal(error)
        if refused is None:
            raise
        code, sentence = refused
        sys.stderr.write(f"twin: {sentence}\n")  # what colours it may be what there is no memory for
    if code == EXIT_INTERRUPTED:
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
    the process and make an exit code of 130 out of a success.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _interrupted() -> int:
    from twin.cli.output import error_line

    error_line(_INTERRUPTED)
    return EXIT_INTERRUPTED


def run(arguments: Sequence[str] | None = None) -> int:
    """Run `twin` with the given arguments (default: the process's own) and return the exit code."""
    from typer.main import get_command

    from twin.cli.app import app
    from twin.cli.output import error_line
    from twin.cli.usage import UsageError, usage_sentence

    twin = get_command(app)
    try:
        code = twin.main(arguments, prog_name="twin", standalone_mode=False) or EXIT_OK
        sys.stdout.flush()
    except UsageError as error:
        sentence = usage_sentence(error, twin, sys.argv[1:] if arguments is None else arguments)
        if sentence:
            error_line(sentence)
        return EXIT_USAGE
    except KeyboardInterrupt:
        return _interrupted()
    except OutputError as error:
        if error.nobody_reads:
            return EXIT_NO_READER
        error_line(str(error))
        return EXIT_MACHINE
    except Exception as error:
        code = exit_code(error)
        if code == EXIT_BUG:
            raise
        error_line(_with_option(error))
        return code
    return _interrupted() if code == EXIT_INTERRUPTED else code


def _with_option(error: Exception) -> str:
    """Return an error's sentence; where the library knows a cure but not the option for it, with that."""
    from nvdb.mirror import MassDeletionError

    if isinstance(error, MassDeletionError):
        return f"{str(error).removesuffix('.')} (--confirm-deletions)."
    return str(error)
