"""Messages of a topic at an MQTT broker, by Paho."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from threading import Event
from typing import TYPE_CHECKING

from twin.errors import MissingExtraError
from twin.live.sources.links import Connection, Piece

if TYPE_CHECKING:
    from paho.mqtt.client import Client, ConnectFlags, MQTTMessage
    from paho.mqtt.properties import Properties
    from paho.mqtt.reasoncodes import ReasonCode

_ONLY = 0
_CONNECT_S, _HANG_UP_S, _LOOK_S = 5.0, 0.5, 0.05
_ALIVE_S = 10
"""A broker that says nothing for half again as long is gone."""


@dataclass(frozen=True, slots=True)
class MqttLink:
    """A topic, which may have wildcards; a message holds whole lines.

    Raises
    ------
    MissingExtraError
        If Paho is not installed.
    """

    host: str
    port: int
    topic: str
    user: str | None = None
    password: str | None = field(default=None, repr=False)
    tls: bool = False
    ends: bool = False
    asks_again: bool = False

    def __post_init__(self) -> None:
        try:
            import paho.mqtt.client  # noqa: F401
        except ImportError as error:
            raise MissingExtraError(
                f"The source mqtt://{self.host}/{self.topic}", "paho-mqtt", "live"
            ) from error

    def open(self, _stopped: Event) -> Connection:
        """Connect and subscribe."""
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion

        client = Client(CallbackAPIVersion.VERSION2)
        client.connect_timeout = _CONNECT_S
        if self.user is not None:
            client.username_pw_set(self.user, self.password)
        if self.tls:
            client.tls_set()
        subscribed = _Subscribed(client, self.topic)
        client.connect(self.host, self.port, keepalive=_ALIVE_S)
        return subscribed


class _Subscribed:
    def __init__(self, client: Client, topic: str) -> None:
        self._client, self._topic = client, topic
        self._pieces: list[Piece] = []
        self._refused = ""
        client.on_connect = self._connected
        client.on_message = self._take

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

    def _connected(
        self,
        _client: Client,
        _data: object,
        _flags: ConnectFlags,
        reason: ReasonCode,
        _more: Properties | None,
    ) -> None:
        if reason.is_failure:
            self._refused = f"the broker refuses: {reason}"
        else:
            # Anew at each connection: a broker that was restarted knows nothing of it.
            self._client.subscribe(self._topic)

    def _take(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        payload = bytes(message.payload)
        self._pieces.append(Piece(_ONLY, payload if payload.endswith(b"\n") else payload + b"\n"))
