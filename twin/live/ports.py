"""Where a live drive's data come from and go to: every source and every sink has one of these shapes.

Who runs them gives each its own thread, so that either may block; what passes between threads is bounded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import Any, NamedTuple, Protocol

from twin.live.estimates import Estimate
from twin.live.events import Arrival


class TroubleKind(StrEnum):
    """What is wrong with a source."""

    LOST = "lost"
    """It ended or does not answer; the source goes on trying."""
    ENDED = "ended"
    """It ended for good."""
    BACK = "back"
    """It answers again."""
    GARBAGE = "garbage"
    """What came cannot be read, and was left out."""
    REFUSED = "refused"
    """Frames came of a camera that the car does not have, and were left out."""
    CLOCK = "clock"
    """Its time stepped, or stands."""
    DROPPED = "dropped"
    """It gives more than can be taken, and some was left out: a camera that is too fast for its detector."""


class Trouble(NamedTuple):
    """A source's own report that something is wrong, or well again.

    Attributes
    ----------
    at_ns : int
        By the host's clock, UTC.
    source : str
        Its address, without a password.
    kind : TroubleKind
    count : int
        How many lines, messages or frames it concerns.
    detail : str
        For people; nothing decides by it.
    """

    at_ns: int
    source: str
    kind: TroubleKind
    count: int = 1  # type: ignore[assignment]  # a tuple's method of this name, which nobody calls
    detail: str = ""


class Source(Protocol):
    """A socket, a port, a file: what gives arrivals until it is closed."""

    @property
    def name(self) -> str:
        """Return its address, without a password."""

    def arrivals(self) -> Iterator[Arrival | Trouble]:
        """Yield what arrives, and what goes wrong; return when it ended for good or was closed."""

    def close(self) -> None:
        """End `arrivals`, from another thread."""


class Said(Protocol):
    """An estimate, a verdict, the car's state: what sinks are given."""

    @property
    def id(self) -> str:
        """Return what it is about: one of the same class and id that is said later replaces it."""

    @property
    def lasts(self) -> bool:
        """Whether it is kept in the file, and goes before the rest where a sink is slow: finals, verdicts."""

    def feature(self) -> dict[str, Any]:
        """Return it as a GeoJSON feature."""


class Recording(Protocol):
    """What sources record what they receive into."""

    failure: str
    """Why it takes no more, one sentence; "" while it does."""


class LiveCheck(Protocol):
    """What holds estimates against the road database."""

    def take(self, arrival: Arrival, estimates: Sequence[Estimate]) -> Sequence[Said]:
        """Take what has arrived, and the estimates that came of it; return verdicts, new or changed."""

    def let_pass(self, now_ns: int, estimates: Sequence[Estimate]) -> Sequence[Said]:
        """Take that it is so late and nothing has arrived, with the estimates that came of that."""

    def finish(self, estimates: Sequence[Estimate]) -> Sequence[Said]:
        """End the drive, with the estimates that its end has made final; return the last verdicts."""


class Sink(Protocol):
    """Standard output, a broker, a page: where lines go."""

    must_arrive: bool
    """Whether a recorded drive waits for it rather than leave a line out: a file, not a broker."""

    @property
    def name(self) -> str:
        """Return its address, without a password."""

    def write(self, said: Said) -> None:
        """Hand on; may block."""

    def close(self) -> None:
        """Hand on what waits, and end."""
