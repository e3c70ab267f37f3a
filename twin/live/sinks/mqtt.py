"""Lines as messages of a topic at an MQTT broker, by Paho, which connects again whenever it must."""

from __future__ import annotations

import time
from threading import Condition
from typing import TYPE_CHECKING

from twin.errors import ConfigError
from twin.live.features import line_of
from twin.live.ports import Said
from twin.live.sources.address import MQTT_SCHEMES, address_of
from twin.live.sources.mqtt_client import check_paho, client_of, topic_of

if TYPE_CHECKING:
    from paho.mqtt.client import Client, DisconnectFlags
    from paho.mqtt.properties import Properties
    from paho.mqtt.reasoncodes import ReasonCode

_MOST_UNDER_WAY = 100
_LAST_S = 2.0
_OF_TOPICS = frozenset("#+")


class Mqtt:
    """A topic. What lasts is sent until the broker has it (QoS 1), the rest once.

    Parameters
    ----------
    url : str
        ``mqtt://USER:PASSWORD@HOST:PORT/TOPIC``, or ``mqtts://``.

    Raises
    ------
    ConfigError
        If it is no such address, or its topic is none to send to.
    MissingExtraError
        If Paho is not installed.
    """

    must_arrive = False

    def __init__(self, url: str) -> None:
        address = address_of(url, MQTT_SCHEMES)
        self._name, self._topic = address.name, topic_of(address)
        check_paho(f"--to {self._name}")
        if not self._topic or _OF_TOPICS & set(self._topic):
            raise ConfigError(
                f"{self._name} names no topic to send to: write one, as in mqtt://HOST/twin/live."
            )
        self._changed = Condition()
        self._is_connected = False
        self._under_way: dict[int, bool] = {}
        # Arrived before whoever sent it has noted that it was under way.
        self._early: set[int] = set()
        self._client = client_of(address, self._connected)
        self._client.on_disconnect, self._client.on_publish = self._disconnected, self._published
        self._client.reconnect_delay_set(1, 10)
        self._client.loop_start()

    @property
    def name(self) -> str:
        """Return its address, without user and password."""
        return self._name

    def write(self, said: Said) -> None:
        """Send a line, when there is a broker; what lasts, when it has taken what went before."""
        from paho.mqtt.enums import MQTTErrorCode

        with self._changed:
            while not self._is_connected or len(self._under_way) >= _MOST_UNDER_WAY:
                self._changed.wait()
        # Without the lock: Paho's thread has locks of its own when it says that a message has arrived.
        sent = self._client.publish(self._topic, line_of(said), qos=int(said.lasts))
        with self._changed:
            # What is sent once is lost without a connection; the rest Paho keeps until there is one.
            if sent.mid not in self._early and (said.lasts or sent.rc == MQTTErrorCode.MQTT_ERR_SUCCESS):
                self._under_way[sent.mid] = said.lasts
            self._early.clear()

    def close(self) -> None:
        """Wait a little for what is under way, and leave."""
        until_s = time.monotonic() + _LAST_S
        with self._changed:
            while self._under_way and (left_s := until_s - time.monotonic()) > 0.0:
                self._changed.wait(left_s)
        self._client.disconnect()
        self._client.loop_stop()

    def _published(
        self, _client: Client, _data: object, message: int, _reason: ReasonCode, _more: Properties | None
    ) -> None:
        with self._changed:
            if self._under_way.pop(message, None) is None:
                self._early.add(message)
            self._changed.notify_all()

    def _connected(self, reason: ReasonCode) -> None:
        with self._changed:
            self._is_connected = not reason.is_failure
            self._changed.notify_all()

    def _disconnected(
        self,
        _client: Client,
        _data: object,
        _flags: DisconnectFlags,
        _reason: ReasonCode,
        _more: Properties | None,
    ) -> None:
        with self._changed:
            self._is_connected = False
            self._under_way = {message: lasts for message, lasts in self._under_way.items() if lasts}
