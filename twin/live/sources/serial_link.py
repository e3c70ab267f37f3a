"""Serial ports, by pyserial."""

from __future__ import annotations

from dataclasses import dataclass
from threading import Event
from typing import TYPE_CHECKING

from twin.errors import MissingExtraError
from twin.live.sources.links import Connection, Piece

if TYPE_CHECKING:
    from serial import Serial

USUAL_BAUD = 115_200
_ONLY = 0


@dataclass(frozen=True, slots=True)
class SerialLink:
    """A serial port; what is unplugged and plugged in again is opened again.

    Raises
    ------
    MissingExtraError
        If pyserial is not installed.
    """

    device: str
    baud: int = USUAL_BAUD
    ends: bool = False
    asks_again: bool = False

    def __post_init__(self) -> None:
        try:
            import serial  # noqa: F401
        except ImportError as error:
            raise MissingExtraError(f"The serial port {self.device}", "pyserial", "live") from error

    def open(self, _stopped: Event) -> Connection:
        """Open the device."""
        from serial import Serial

        return _Port(Serial(self.device, self.baud))


@dataclass(frozen=True, slots=True)
class _Port:
    port: Serial

    def read(self, patience_s: float) -> list[Piece]:
        self.port.timeout = patience_s
        data = self.port.read(1)
        data += self.port.read(self.port.in_waiting) if data else b""
        return [Piece(_ONLY, data)] if data else []

    def close(self) -> None:
        self.port.close()
