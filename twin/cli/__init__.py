"""The command line: parse, call one function, print. Exit codes live here alone.

==== =========================================================
code meaning
==== =========================================================
0    done
1    an error in twin itself (please report it); ``match
     --exit-code`` alone says so that findings are open
2    usage: unknown command or option, wrong value
3    network: the API did not answer as it should
4    bad data: a drive, a store, a truth file, an API's objects
5    refused: doing it would lose or overwrite something
130  interrupted
==== =========================================================
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence

EXIT_OK, EXIT_BUG, EXIT_USAGE, EXIT_NETWORK, EXIT_DATA, EXIT_REFUSED, EXIT_INTERRUPTED = 0, 1, 2, 3, 4, 5, 130

_INTERRUPTED = (
    "Interrupted: the store shows the old state or the whole new one; run the command again to go on."
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run `twin` and leave with its exit code."""
    try:
        code = run(arguments)
        _leave_uninterrupted()
    except KeyboardInterrupt:  # while modules are loaded, or in the instant after the work
        _leave_uninterrupted()
        code = _interrupted()
    sys.exit(code)


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
    from twin.cli.app import app
    from twin.cli.output import error_line

    for stream in (sys.stdout, sys.stderr):
        # A pipe on Windows is not UTF-8 by itself, and sign texts are Norwegian.
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding="utf-8", errors="replace")
    try:
        app(args=arguments, prog_name="twin", standalone_mode=True)
    except SystemExit as stop:
        code = stop.code if isinstance(stop.code, int) else EXIT_OK
        return _interrupted() if code == EXIT_INTERRUPTED else code
    except KeyboardInterrupt:
        return _interrupted()
    except BrokenPipeError:
        sys.stderr.close()
        return EXIT_OK
    except Exception as error:
        code = exit_code(error)
        if code == EXIT_BUG:
            raise
        error_line(_with_option(error))
        return code
    return EXIT_OK


def _with_option(error: Exception) -> str:
    """Return an error's sentence; where the library knows a cure but not the option for it, with that."""
    from nvdb.mirror.sync import MassDeletionError

    if isinstance(error, MassDeletionError):
        return f"{str(error).removesuffix('.')} (--confirm-deletions)."
    return str(error)


def exit_code(error: BaseException) -> int:
    """Return the exit code that belongs to an exception; 1 for what twin does not expect."""
    from geoloc.errors import GeolocError
    from nvdb.errors import NvdbError, RequestError, TransportError
    from nvdb.mirror.sync import MassDeletionError
    from twin.errors import ConfigError, RefusedError, TwinError

    if isinstance(error, RefusedError | MassDeletionError):
        return EXIT_REFUSED
    if isinstance(error, RequestError | ConfigError):
        return EXIT_USAGE
    if isinstance(error, TransportError):
        return EXIT_NETWORK
    if isinstance(error, NvdbError | TwinError | GeolocError):
        return EXIT_DATA
    return EXIT_BUG
