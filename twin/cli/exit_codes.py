"""Exit codes, here and nowhere else.

==== =========================================================
code meaning
==== =========================================================
0    done
1    an error in twin itself (please report it); ``match
     --exit-code`` alone says so that findings are open
2    usage: unknown command or option, wrong value
3    network: the API did not answer as it should
4    bad data: a drive, a store, a truth file, an API's objects,
     a file that cannot be read or written
5    refused: doing it would lose or overwrite something
6    the machine: too little memory, or standard output cannot
     be written; what was done so far is kept
130  interrupted
141  the reader of standard output has left (``| head``), as of
     programs that SIGPIPE ends
==== =========================================================
"""

from __future__ import annotations

EXIT_OK, EXIT_BUG, EXIT_USAGE, EXIT_NETWORK, EXIT_DATA, EXIT_REFUSED, EXIT_MACHINE = range(7)
EXIT_INTERRUPTED, EXIT_NO_READER = 130, 141
EXIT_OPEN_FINDINGS = 1
"""As of ``git diff --exit-code``, and only where it was asked for."""


def exit_code(error: BaseException) -> int:
    """Return the exit code that belongs to an exception; 1 for what twin does not expect."""
    from geoloc.errors import GeolocError
    from nvdb.errors import NvdbError, RequestError, TransportError
    from nvdb.mirror import MassDeletionError
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
