"""A client of an MQTT broker, by Paho: what listens to a topic and what sends to one begin alike."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from twin.errors import MissingExtraError
from twin.live.sources.address import Address

if TYPE_CHECKING:
    from paho.mqtt.client import Client
    from paho.mqtt.reasoncodes import ReasonCode

_ALIVE_S = 10
"""A broker that says nothing for half again as long is gone."""


def check_paho(asked_for: str) -> None:
    """Look whether there is Paho, before the car drives.

    Raises
    ------
    MissingExtraError
        If it is not installed.
    """
    try:
        import paho.mqtt.client  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(asked_for, "paho-mqtt", "live") from error


def topic_of(address: Address) -> str:
    """Return the topic that an address names, "" where it names none."""
    return address.path.removeprefix("/")


def client_of(address: Address, connected: Callable[[ReasonCode], None]) -> Client:
    """Return a client that knows where to connect, and has not yet.

    Parameters
    ----------
    address : Address
        ``mqtt://USER:PASSWORD@HOST:PORT/TOPIC``, or ``mqtts://``.
    connected : callable
        Gets what the broker answered, at each connection anew.
    """
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    client = Client(CallbackAPIVersion.VERSION2)
    if address.user is not None:
        client.username_pw_set(address.user, address.password)
    if address.scheme == "mqtts":
        client.tls_set()
    client.on_connect = lambda _client, _data, _flags, reason, _more: connected(reason)
    client.connect_async(address.host, address.port, keepalive=_ALIVE_S)
    return client
