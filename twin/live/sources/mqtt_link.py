"""Messages of a topic at an MQTT broker, by Paho."""

from __future__ import annotations

import time
from dataclasses import dataclass
from threading import Event
from typing import TYPE_CHECKING

from twin.live.sources.address import Address
from twin.live.sources.links import Connection, Piece
from twin.live.sources.mqtt_client import check_paho, client_of, topic_of

if TYPE_CHECKING:
    from paho.mqtt.client import Client, MQTTMessage
    from paho.mqtt.reasoncodes import ReasonCode

_ONLY = 0
_HANG_UP_S, _LOOK_S = 0.5, 0.05


@dataclass(frozen=True, slots=True)
class MqttLink:
    """A topic, which may have wildcards; a message holds whole lines.

    Raises
    ------
    MissingExtraError
        If Paho is not installed.
    """

    address: Address
    ends: bool = False
    asks_again: bool = False

    def __post_init__(self) -> None:
        check_paho(f"The source {self.address.name}")

    def open(self, _stopped: Event) -> Connection:
        """Connect and subscribe."""
        return _Subscribed(self.address)


class _Subscribed:
    def __init__(self, address: Address) -> None:
        self._topic = topic_of(address)
        self._pieces: list[Piece] = []
        self._refused = ""
        self._client = client_of(address, self._connected)
        self._client.on_message = self._take
        self._client.reconnect()

    def read(self, patience_s: float) -> list[Piece]:
        code = self._client.loop(patience_s)
        if code or self._refused:
            raise ConnectionError(self._refused or "the broker has gone")
        pieces, self._pieces = self._pieces, []
        return pieces

    def close(self) -> None:
        self._client.disconnect()
        # Until the broker has hung up, which it does at once.
        until_s = time.monotonic() + _HANG_UP_S
        while self._client.loop(_LOOK_S) == 0 and time.monotonic() < until_s:
            pass

    def _connected(self, reason: ReasonCode) -> None:
        if reason.is_failure:
            self._refused = f"the broker refuses: {reason}"
        else:
            # Anew at each connection: a broker that was restarted knows nothing of it.
            self._client.subscribe(self._topic)

    def _take(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        payload = bytes(message.payload)
        self._pieces.append(Piece(_ONLY, payload if payload.endswith(b"\n") else payload + b"\n"))
