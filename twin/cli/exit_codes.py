"""Exit codes, here and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass

EXIT_OK, EXIT_BUG, EXIT_USAGE, EXIT_NETWORK, EXIT_DATA, EXIT_REFUSED, EXIT_MACHINE = range(7)
EXIT_INTERRUPTED, EXIT_NO_READER, EXIT_TERMINATED = 130, 141, 143
EXIT_OPEN_FINDINGS = 1
"""As of ``git diff --exit-code``, and only where it was asked for."""


@dataclass(frozen=True, slots=True)
class ExitCode:
    """One exit code of `twin`.

    Attributes
    ----------
    code : int
    kind : str
        One word, as ``kind`` of the error that ``--json`` prints on stderr.
    meaning : str
        For people; what the documentation says.
    """

    code: int
    kind: str
    meaning: str


EXIT_CODES = (
    ExitCode(EXIT_OK, "ok", "Done."),
    ExitCode(
        EXIT_BUG,
        "bug",
        "An error in twin itself: please report it. Of `--exit-code` alone: findings of `twin match` are "
        "open, or cameras of `twin calibrate diff` differ.",
    ),
    ExitCode(EXIT_USAGE, "usage", "An unknown command or option, a wrong value, a wrong setting in a file."),
    ExitCode(
        EXIT_NETWORK,
        "network",
        "The network: NVDB, or the storage or scheduler of a fleet, did not answer as it should.",
    ),
    ExitCode(
        EXIT_DATA,
        "data",
        "Bad data: a file or folder that is missing, damaged, or cannot be read or written, also for want of "
        "space; an answer of NVDB that is not as documented; a drive that is not ready; a change set that is "
        "refused.",
    ),
    ExitCode(EXIT_REFUSED, "refused", "Refused: doing it would lose or overwrite something."),
    ExitCode(
        EXIT_MACHINE,
        "machine",
        "The machine: too little memory, or standard output cannot be written. What was done so far is kept.",
    ),
    ExitCode(EXIT_INTERRUPTED, "interrupted", "Interrupted by Ctrl-C. Run the command again to go on."),
    ExitCode(
        EXIT_NO_READER,
        "no_reader",
        "The reader of standard output has left, as in `twin match | head -1`. No message, and no fault.",
    ),
    ExitCode(
        EXIT_TERMINATED,
        "terminated",
        "Ended by SIGTERM, as `systemctl stop` or a shutdown sends it. Run the command again to go on.",
    ),
)
"""All of them, in order."""


def kind_of(code: int) -> str:
    """Return the word for an exit code."""
    return next(one.kind for one in EXIT_CODES if one.code == code)


def exit_code(error: BaseException) -> int:
    """Return the exit code that belongs to an exception; 1 for what twin does not expect."""
    from geoloc.errors import GeolocError
    from nvdb.errors import NvdbError, RequestError, TransportError
    from nvdb.mirror import MassDeletionError
    from twin.errors import ConfigError, RefusedError, StorageError, TwinError

    if isinstance(error, RefusedError | MassDeletionError):
        return EXIT_REFUSED
    if isinstance(error, RequestError | ConfigError):
        return EXIT_USAGE
    if isinstance(error, TransportError | StorageError):
        return EXIT_NETWORK
    if isinstance(error, NvdbError | TwinError | GeolocError):
        return EXIT_DATA
    return EXIT_BUG
