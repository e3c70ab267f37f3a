"""Logs of a CAN bus (ASC, BLF, candump, TRC), read by python-can, with a DBC, read by cantools.

Messages that no signal is asked of are not decoded. Values outside the range that the DBC gives a signal are
left out: that is how a car says that it has none.
"""

from __future__ import annotations

import logging
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from geoloc.arrays import FloatArray, IntArray
from twin.drives.epochs import credible
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.motion_settings import MotionSource
from twin.drives.folder.sensor_names import which_of
from twin.drives.folder.toml_values import SETTINGS_FILE
from twin.drives.motion.clocks import counted_from, in_zone
from twin.drives.motion.samples import MotionRead, Samples
from twin.errors import DriveError, MissingExtraError

if TYPE_CHECKING:
    from cantools.database import Database, Message, Signal

CANDUMP = ".log"
SUFFIXES = (".asc", ".blf", CANDUMP, ".trc")
UNREAD = (".mf4", ".mdf", ".gz")
"""Logs that other programs write, and that are to be exported as one of `SUFFIXES`."""
_NS_PER_S = 1_000_000_000
_LATEST_S = 9e9


class _Wanted(NamedTuple):
    """One signal that is asked for, and what was found of it."""

    name: str
    message: Message
    signal: Signal
    times_s: list[float]
    values: list[float]


class _Log(NamedTuple):
    """Messages of a log, and from when their times count."""

    reader: Any
    is_clock: bool
    """Whether the times are those of a clock on the wall, whose zone nobody states."""


class _Counted(logging.Handler):
    """Counts what python-can passes over, and would only tell a log of its own."""

    def __init__(self, faults: Counter[str]) -> None:
        super().__init__(logging.WARNING)
        self.faults = faults

    def emit(self, record: logging.LogRecord) -> None:
        """Count one line."""
        del record
        self.faults["line that is no message"] += 1


def is_can_log(_folder: DriveFolder, source: MotionSource) -> bool:
    """Whether a file is a log of a CAN bus, by its name or because a DBC is named beside it."""
    return source.dbc is not None or source.file.lower().endswith((*SUFFIXES, *UNREAD))


def read(folder: DriveFolder, source: MotionSource) -> MotionRead:
    """Read the signals that ``drive.toml`` names.

    Raises
    ------
    MissingExtraError
        Without python-can and cantools.
    DriveError
        If the log or the DBC cannot be read, a signal is not in the DBC or none of its messages in the log,
        or it is not clear what the times count from.
    """
    suffix = PurePosixPath(source.file).suffix.lower()
    if suffix not in SUFFIXES:
        raise DriveError(
            f"{source.file} is no log of a CAN bus that twin reads ({', '.join(SUFFIXES)}): export it as ASC"
            " or BLF, or as a table (CSV) of the signals."
        )
    if source.dbc is None or not source.names:
        raise DriveError(
            f"{source.file} is a log of a CAN bus: give [{source.table}] dbc, the file that says what its"
            f' messages mean, and speed, turn_rate or wheel_angle = "MESSAGE.SIGNAL" in {SETTINGS_FILE}.'
        )
    wanted = _wanted(_database(folder.content(source.dbc), source), source)
    faults: Counter[str] = Counter()
    stamps = _decoded(folder.recording(source.file, track=False), suffix, source, wanted, faults)
    by_name = {one.name: _samples(one, stamps[one.name]) for one in wanted}
    samples = {q: [by_name[name] for name in source.of(q).names] for q in source.named}
    return MotionRead(samples, faults=faults)


def _database(content: bytes, source: MotionSource) -> Database:
    try:
        import cantools.database
    except ImportError as error:
        raise MissingExtraError(f"The DBC {source.dbc}", "cantools", "can") from error
    try:
        text = content.decode("cp1252", errors="replace")
        return cantools.database.load_string(text, "dbc", strict=False)  # type: ignore[return-value]
    except Exception as error:  # damage shows in parsers as errors of nearly every kind
        told = str(error).strip().partition("\n")[0]
        raise DriveError(
            f"{source.dbc} cannot be read as a DBC ({told:.120}): export it again from the program that"
            " describes the bus."
        ) from error


def _wanted(database: Database, source: MotionSource) -> list[_Wanted]:
    """The signals of the DBC that are asked for."""
    signals = {f"{m.name}.{s.name}": (m, s) for m in database.messages for s in m.signals}
    for name in source.names:
        if name not in signals:
            raise DriveError(
                f"{SETTINGS_FILE} names the signal {name}, which {source.dbc} does not have"
                f" ({which_of('signals', name, signals)}): correct [{source.table}]."
            )
    return [_Wanted(name, *signals[name], [], []) for name in dict.fromkeys(source.names)]


def _decoded(
    path: Path, suffix: str, source: MotionSource, wanted: list[_Wanted], faults: Counter[str]
) -> Mapping[str, IntArray]:
    """Epochs of the values of each signal, which are put into `wanted`."""
    by_id: dict[tuple[int, bool], list[_Wanted]] = defaultdict(list)
    for one in wanted:
        by_id[one.message.frame_id, one.message.is_extended_frame].append(one)
    log = _opened(path, suffix, source)
    with log.reader, _counting(faults):
        for message in _messages(log, source, faults):
            for one in by_id.get((message.arbitration_id, message.is_extended_id), ()):
                _take(one, message, faults)
        _refuse_steps(log, source)
        shift_s = _shift_s(log, source)
    for one in wanted:
        if not one.values:
            raise DriveError(
                f"{source.file} holds no value of {one.name} (message {one.message.frame_id:#x} of"
                f" {source.dbc}): check that DBC and log are of this car and this bus."
            )
    return {one.name: _epochs(np.array(one.times_s) + shift_s, log, source) for one in wanted}


@contextmanager
def _counting(faults: Counter[str]) -> Iterator[None]:
    handler, logger = _Counted(faults), logging.getLogger("can")
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


def _opened(path: Path, suffix: str, source: MotionSource) -> _Log:
    try:
        import can
    except ImportError as error:
        raise MissingExtraError(f"The CAN log {source.file}", "python-can", "can") from error
    # The library leaves a file open that it cannot begin with.
    file = path.open("rb") if suffix == ".blf" else path.open(encoding="cp1252", errors="replace")
    readers: Mapping[str, Callable[[Any], Any]] = {
        ".asc": partial(can.ASCReader, relative_timestamp=source.time_zero_ns is not None),
        ".blf": can.BLFReader,
        ".trc": can.TRCReader,
        CANDUMP: can.CanutilsLogReader,
    }
    try:
        return _Log(readers[suffix](file), is_clock=suffix != CANDUMP)
    except Exception as error:
        file.close()
        raise _unreadable(source, error) from error


def _messages(log: _Log, source: MotionSource, faults: Counter[str]) -> Iterator[Any]:
    """Messages up to the first damage, which is counted: what follows it cannot be trusted."""
    messages, n = iter(log.reader), 0
    while True:
        try:
            message = next(messages)
        except StopIteration:
            return
        except Exception as error:
            if not n:
                raise _unreadable(source, error) from error
            faults["log damaged: the rest of it"] += 1
            return
        n += 1
        if not (message.is_error_frame or message.is_remote_frame):
            yield message


def _unreadable(source: MotionSource, error: Exception) -> DriveError:
    told = str(error).strip().partition("\n")[0]
    return DriveError(
        f"{source.file} cannot be read as a CAN log ({type(error).__name__}: {told:.120}): export it again as"
        " ASC or BLF."
    )


def _take(one: _Wanted, message: Any, faults: Counter[str]) -> None:
    try:
        decoded = one.message.decode(bytes(message.data), decode_choices=False)
        value = float(decoded[one.signal.name])  # type: ignore[call-overload,arg-type]
    except KeyError:  # of another group of a multiplexed message
        return
    except Exception:
        faults["message that the DBC does not fit"] += 1
        return
    least, most = one.signal.minimum, one.signal.maximum
    if least is not None and most is not None and least < most and not least <= value <= most:
        faults["value outside the range of the DBC"] += 1
        return
    one.times_s.append(float(message.timestamp))
    one.values.append(value)


def _refuse_steps(log: _Log, source: MotionSource) -> None:
    """Refuse an ASC whose times are those since the message before: other lines between them count too."""
    if getattr(log.reader, "timestamps_format", None) == "relative":
        raise DriveError(
            f"{source.file} gives each time since the message before (timestamps relative): export it with"
            " absolute times."
        )


def _shift_s(log: _Log, source: MotionSource) -> float:
    """What to add to times of messages: they then count from the log's start, or are a clock's as if UTC."""
    import can

    reader, from_start = log.reader, source.time_zero_ns is not None
    if isinstance(reader, can.ASCReader):
        # The library takes the date for one in this machine's zone: that is undone.
        moment = datetime.fromtimestamp(reader.start_time, UTC).astimezone()
        return moment.utcoffset().total_seconds() if reader.start_time else 0.0  # type: ignore[union-attr]
    if isinstance(reader, can.BLFReader):
        return -float(reader.start_timestamp) if from_start else 0.0
    if isinstance(reader, can.TRCReader):
        return -reader.start_time.timestamp() if from_start and reader.start_time else 0.0
    return 0.0


def _epochs(times_s: FloatArray, log: _Log, source: MotionSource) -> IntArray:
    if not np.abs(times_s).max() < _LATEST_S:
        raise DriveError(f"{source.file} has times that are none: export it again.")
    stamp_ns = np.round(times_s * _NS_PER_S).astype(np.int64)
    if log.is_clock and source.time_zero_ns is None and credible(int(np.median(stamp_ns))):
        return in_zone(stamp_ns, source)
    return counted_from(stamp_ns, source, f"{times_s[0]:.3f}")


def _samples(one: _Wanted, stamp_ns: IntArray) -> Samples:
    return Samples(stamp_ns, np.array(one.values), unit=one.signal.unit or "")
