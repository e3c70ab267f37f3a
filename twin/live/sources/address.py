"""Addresses of sources, taken apart and checked."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple
from urllib.parse import parse_qsl, unquote, urlsplit, urlunsplit

from twin.errors import ConfigError

STDIN = "-"
_HELP = "twin help live lists them."


class Gives(StrEnum):
    """What an address is asked for."""

    FIXES = "fixes"
    DETECTIONS = "detections"


class Scheme(NamedTuple):
    """What an address of one kind may say.

    Attributes
    ----------
    port : int or None
        Where it says none; None where it must.
    options : tuple of str or None
        Behind the question mark; None: any, which are those of a camera.
    listens : bool
        Whether an address without a host is one on this machine.
    is_path : bool
        Whether it names a file or a device.
    """

    port: int | None = None
    options: tuple[str, ...] | None = ()
    listens: bool = False
    is_path: bool = False


_GPSD_PORT, _MQTT_PORT, _MQTTS_PORT = 2947, 1883, 8883
_RTSP_PORT, _RTSPS_PORT, _HTTP_PORT, _HTTPS_PORT = 554, 322, 80, 443
_ANTENNA = ("antenna",)
FIX_SCHEMES: Mapping[str, Scheme] = {
    "serial": Scheme(options=(*_ANTENNA, "baud"), is_path=True),
    "serial+sbp": Scheme(options=(*_ANTENNA, "baud"), is_path=True),
    "tcp": Scheme(options=_ANTENNA),
    "tcp+sbp": Scheme(options=_ANTENNA),
    "udp": Scheme(options=_ANTENNA, listens=True),
    "udp+sbp": Scheme(options=_ANTENNA, listens=True),
    "gpsd": Scheme(_GPSD_PORT, options=_ANTENNA),
    "mcap": Scheme(options=(*_ANTENNA, "topic", "speed"), is_path=True),
    "ros2": Scheme(options=_ANTENNA, is_path=True),
}
MQTT_SCHEMES: Mapping[str, Scheme] = {"mqtt": Scheme(_MQTT_PORT), "mqtts": Scheme(_MQTTS_PORT)}
DETECTION_SCHEMES: Mapping[str, Scheme] = {
    "tcp": Scheme(options=("listen",), listens=True),
    "udp": Scheme(listens=True),
    **MQTT_SCHEMES,
    "mcap": Scheme(options=("topic", "speed"), is_path=True),
    "ros2": Scheme(is_path=True),
    STDIN: Scheme(),
}
PICTURE_SCHEMES: Mapping[str, Scheme] = {
    "rtsp": Scheme(_RTSP_PORT, options=None),
    "rtsps": Scheme(_RTSPS_PORT, options=None),
    "http": Scheme(_HTTP_PORT, options=None),
    "https": Scheme(_HTTPS_PORT, options=None),
    "v4l2": Scheme(options=("camera",), is_path=True),
    "file": Scheme(options=("camera",), is_path=True),
}


@dataclass(frozen=True, slots=True)
class Address:
    """An address.

    Attributes
    ----------
    name : str
        Without user, password and options: for messages and logs.
    scheme : str
    host : str
        "" for all addresses of this machine.
    port : int
        0 where there is none.
    path : str
    user, password : str or None
    options : mapping of str to str
    url : str
        As given.
    """

    name: str
    scheme: str
    host: str = ""
    port: int = 0
    path: str = ""
    user: str | None = None
    password: str | None = field(default=None, repr=False)
    options: Mapping[str, str] = field(default_factory=dict, repr=False)
    url: str = field(default="", repr=False)

    def without(self, option: str) -> str:
        """Return the address as given, but for one of its options."""
        parts = urlsplit(self.url, allow_fragments=False)
        kept = [pair for pair in parts.query.split("&") if pair.partition("=")[0] != option]
        return urlunsplit(parts._replace(query="&".join(kept)))

    def number(self, option: str, default: int) -> int:
        """Return an option that is a whole number above 0.

        Raises
        ------
        ConfigError
            If it is none.
        """
        text = self.options.get(option)
        if text is None:
            return default
        if not (text.isascii() and text.isdigit() and 0 < int(text[:12]) == int(text)):
            raise ConfigError(f"{self.name}: {option} takes a whole number above 0, but not {text:.40}.")
        return int(text)


def address_of(url: str, schemes: Mapping[str, Scheme]) -> Address:
    """Take an address apart.

    Parameters
    ----------
    url : str
    schemes : mapping of name to Scheme
        Those that are possible here.

    Raises
    ------
    ConfigError
        If it is none of them, or says what such an address cannot say. The message has no password in it.
    """
    if url == STDIN and STDIN in schemes:
        return Address(STDIN, STDIN)
    try:
        # In a topic # is a wildcard, in a file's name a letter.
        parts = urlsplit(url, allow_fragments=False)
        port = parts.port
        pairs = parse_qsl(parts.query, keep_blank_values=True)
    except ValueError:
        raise ConfigError(f"One of the addresses is no address: correct it; {_HELP}") from None
    scheme = schemes.get(parts.scheme)
    if scheme is None:
        known = ", ".join(name if name == STDIN else f"{name}://" for name in sorted(schemes))
        told = f"{parts.scheme}://" if parts.scheme else f"{url.partition('@')[2] or url:.40}"
        raise ConfigError(f"{told} is no address that fits here: it begins with one of {known}. {_HELP}")
    host = parts.hostname or ""
    path = unquote(f"{parts.netloc}{parts.path}" if scheme.is_path else parts.path)
    number = port if port is not None else scheme.port
    name = f"{parts.scheme}://" + (path if scheme.is_path else _place(host, number, path))
    _check(name, scheme, host, number, path, pairs)
    return Address(
        name,
        parts.scheme,
        host,
        number or 0,
        path,
        None if parts.username is None else unquote(parts.username),
        None if parts.password is None else unquote(parts.password),
        dict(pairs),
        url,
    )


def address_for(url: str, gives: Gives, *, has_detector: bool) -> Address:
    """Take the address of a source apart.

    Raises
    ------
    ConfigError
        For one that is none, or gives something else.
    """
    if gives is Gives.FIXES:
        return address_of(url, FIX_SCHEMES)
    if has_detector:
        return address_of(url, PICTURE_SCHEMES)
    if url.partition("://")[0] in PICTURE_SCHEMES:
        name = address_of(url, PICTURE_SCHEMES).name
        raise ConfigError(
            f"{name} gives pictures: name the network that finds signs in them, --detector MODEL.onnx."
        )
    return address_of(url, DETECTION_SCHEMES)


def _place(host: str, port: int | None, path: str) -> str:
    shown = f"[{host}]" if ":" in host else host
    return f"{shown}:{port}{path}" if port else f"{shown}{path}"


def _check(
    name: str, scheme: Scheme, host: str, port: int | None, path: str, pairs: Collection[tuple[str, str]]
) -> None:
    if scheme.is_path:
        if not path.strip("/"):
            raise ConfigError(f"{name} names no file or device: write it behind the two strokes. {_HELP}")
    elif not host and not scheme.listens:
        raise ConfigError(f"{name} names no host: write it behind the two strokes. {_HELP}")
    elif port is None:
        raise ConfigError(f"{name} has no port: write it behind the host, as in {name}:9000.")
    for option, _ in pairs:
        if scheme.options is not None and option not in scheme.options:
            known = ", ".join(scheme.options) or "none"
            raise ConfigError(f"{name} does not know the option {option:.40}: it knows {known}.")
