"""What people set once: the keys of ``twin.toml``, beside the store and in the user's own folder.

An option stands above the environment, that above the file beside the store, that above the user's file, and
that above the built-in default.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from enum import Enum
from pathlib import Path

from twin.cli.journal import PASSWORD
from twin.cli.options import DEFAULT_STORE
from twin.errors import ConfigError

FILE_NAME = "twin.toml"


class Kind(Enum):
    """What a key takes."""

    TEXT = "text"
    FILE = "path"
    FLAG = "true or false"
    NUMBER = "number"
    AREA = "number or text, or a list of them"


@dataclass(frozen=True, slots=True)
class Setting:
    """One key of ``twin.toml``.

    Attributes
    ----------
    key : str
    kind : Kind
    what : str
        For people, one clause; what the documentation says.
    commands : tuple of str
        Those whose option it stands for; empty where it is no option of a command.
    parameter : str
        Name of the option's parameter there.
    variable : str
        The environment variable that stands above it.
    user_only : bool
        Whether it makes sense in the user's own file alone.
    """

    key: str
    kind: Kind
    what: str
    commands: tuple[str, ...]
    parameter: str
    variable: str
    user_only: bool = False


def _of(key: str, kind: Kind, what: str, *commands: str, parameter: str = "", variable: str = "") -> Setting:
    name = variable or f"TWIN_{key.upper()}"
    return Setting(key, kind, what, commands, parameter or key, name, user_only=key == "store")


_READERS = (
    "sync-nvdb", "ingest-drive", "drives", "match", "explain", "decide", "evidence", "review", "annotate",
    "export", "submit", "evaluate", "show", "status", "confidence", "calibrate from-drives", "config",
)  # fmt: skip
_SPEAKERS = (
    "match", "explain", "decide", "evidence", "review", "annotate", "export", "evaluate", "show", "status",
    "confidence",
)  # fmt: skip

SETTINGS = (
    _of("store", Kind.FILE, "the store that commands take; only in the user's own file", *_READERS),
    _of("log_file", Kind.FILE, "where every command keeps its log, one JSON object a line"),
    _of("lang", Kind.TEXT, "language: en or nb", *_SPEAKERS),
    _of(
        *("by", Kind.TEXT, "who decides, reviews and annotates", "decide", "evidence", "export", "review"),
        *("annotate",),
        variable="TWIN_USER",
    ),
    _of("contact", Kind.TEXT, "e-mail address at which NVDB's staff reach you", "sync-nvdb", "submit"),
    _of("api_url", Kind.TEXT, "address of NVDB's APIs for reading", "sync-nvdb"),
    _of("source", Kind.TEXT, "which of them to mirror: les-v4 or uberiket", "sync-nvdb"),
    _of("kommune", Kind.AREA, "municipality numbers to mirror: 5001, or [5001, 5031]", "sync-nvdb"),
    _of("fylke", Kind.AREA, "county numbers to mirror", "sync-nvdb"),
    _of("kontraktsomrade", Kind.AREA, "contract areas to mirror, by name or id", "sync-nvdb"),
    _of("bbox", Kind.AREA, "box to mirror: [minE, minN, maxE, maxN] in UTM33 metres", "sync-nvdb"),
    _of("vegnett", Kind.FLAG, "whether the road network is mirrored too", "sync-nvdb"),
    _of("method", Kind.TEXT, "adjusted, single-frame or paper", "ingest-drive"),
    _of("terrain", Kind.FILE, "ground raster (GeoTIFF)", "ingest-drive"),
    _of("terrain_heights", Kind.TEXT, "its heights: NN2000 or ellipsoidal", "ingest-drive"),
    _of("labels", Kind.FILE, "what labels mean, instead of a drive's labels.toml", "ingest-drive"),
    _of("detector", Kind.FILE, "network (ONNX) that finds the signs", "ingest-drive"),
    _of("detector_every", Kind.NUMBER, "run it on every so many frames", "ingest-drive"),
    _of("detector_threshold", Kind.NUMBER, "lowest score of its boxes that counts", "ingest-drive"),
    _of("tolerance", Kind.NUMBER, "metres beyond which a sign has moved", "match"),
    _of(
        *("match_settings", Kind.FILE, "settings of matching: the table [matching] of a TOML file", "match"),
        parameter="settings",
    ),
    _of("map_aided", Kind.FLAG, "whether signs that NVDB has measured tie drives to the ground", "match"),
    _of("masker", Kind.FILE, "network (ONNX) that finds people and vehicles", "evidence"),
    _of("base_map", Kind.FLAG, "whether the review page shows Kartverket's map", "review"),
    _of("project", Kind.FLAG, "whether exports have a QGIS project", "export"),
    _of("skriv_url", Kind.TEXT, "address of API Skriv", "export", "submit", parameter="api_url"),
    _of("skriv_user", Kind.TEXT, "user of API Skriv; no password", "submit", parameter="user"),
    _of(
        *("skriv_realm", Kind.TEXT, "EMPLOYEE, SERVICE_ACCOUNT or EXTERNAL", "submit"),
        parameter="realm",
    ),
)  # fmt: skip
"""All keys, in the order of the documentation."""

BY_KEY: Mapping[str, Setting] = {setting.key: setting for setting in SETTINGS}
AREA_KEYS = ("kommune", "fylke", "kontraktsomrade", "bbox")
"""One area is named in one way: a key of them hides the others of files below."""
_SECRET = ("password", "passord", "token", "secret")

Value = str | bool


@dataclass(frozen=True, slots=True)
class Held:
    """A value and the file that holds it; a path in it is taken from that file's folder."""

    value: Value
    file: Path


def settings_of(command: str) -> dict[str, Setting]:
    """Return the keys that stand for options of a command (``calibrate from-drives``), by parameter."""
    return {setting.parameter: setting for setting in SETTINGS if command in setting.commands}


def user_file() -> Path:
    """Return where this user's own file is looked for, as the platform has it."""
    from platformdirs import user_config_path

    return user_config_path("twin", appauthor=False) / FILE_NAME


def store_file(store: Path) -> Path:
    """Return where the file beside a store is looked for."""
    return store.parent / FILE_NAME


def chosen_store(option: str | None) -> Path:
    """Return the store that a command takes, before its other options are looked at."""
    named = option or os.environ.get(BY_KEY["store"].variable)
    if named:
        return Path(named)
    held = read_file(user_file(), beside_store=False).get("store")
    return DEFAULT_STORE if held is None else Path(str(held.value))


def held_settings(store: Path) -> dict[str, Held]:
    """Return what the files hold that apply to a store, by key.

    Raises
    ------
    ConfigError
        A file is no TOML, or has a key that twin does not know or a value that the key does not take.
    """
    users, beside = user_file(), store_file(store)
    held = read_file(users, beside_store=False)
    if beside.absolute() != users.absolute():
        above = read_file(beside, beside_store=True)
        if not above.keys().isdisjoint(AREA_KEYS):
            held = {key: value for key, value in held.items() if key not in AREA_KEYS}
        held |= above
    return held


def read_file(path: Path, *, beside_store: bool) -> dict[str, Held]:
    """Read one file; nothing where there is none.

    Raises
    ------
    ConfigError
        As :func:`held_settings`.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except OSError as error:
        if beside_store and not _may_enter(path.parent):
            return {}  # the store there says it better
        raise ConfigError(f"The settings {path} cannot be read ({error.strerror}): mend that.") from error
    except ValueError as error:
        raise ConfigError(f"The settings {path} are no TOML ({error}): mend that line.") from error
    return {key: Held(_value(key, value, path, beside_store), path) for key, value in table.items()}


def _may_enter(folder: Path) -> bool:
    who = os.access in os.supports_effective_ids
    return os.access(folder, os.X_OK, effective_ids=who)


def _value(key: str, value: object, path: Path, beside_store: bool) -> Value:
    setting = BY_KEY.get(key)
    if setting is None:
        raise ConfigError(_unknown(key, path))
    if setting.user_only and beside_store:
        raise ConfigError(
            f"{path} sets {key}, which only the user's own file can ({user_file()}): this one is found by "
            "the store."
        )
    wrong = ConfigError(f"{path} sets {key} to {value!r}: write {_WANTED[setting.kind]}.")
    if setting.kind is Kind.FLAG:
        if not isinstance(value, bool):
            raise wrong
        return value
    if setting.kind is Kind.AREA:
        parts = value if isinstance(value, list) else [value]
        if not parts or not all(_is_number(part) or isinstance(part, str) for part in parts):
            raise wrong
        return ",".join(map(str, parts))
    if setting.kind is Kind.NUMBER:
        if not _is_number(value):
            raise wrong
        return str(value)
    if not isinstance(value, str) or not value:
        raise wrong
    return str(path.parent / Path(value).expanduser()) if setting.kind is Kind.FILE else value


_WANTED = {
    Kind.TEXT: "a text in quotes",
    Kind.FILE: "a path in quotes",
    Kind.FLAG: "true or false",
    Kind.NUMBER: "a number",
    Kind.AREA: "a number, a text in quotes, or a list of them",
}


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _unknown(key: str, path: Path) -> str:
    if any(word in key.lower() for word in _SECRET):
        return (
            f"{path} holds {key}: what is secret stays out of such files. Take it out there, and keep API "
            f"Skriv's password in the environment as {PASSWORD} or in the keyring."
        )
    near = get_close_matches(key, BY_KEY, n=1)
    perhaps = f" (perhaps {near[0]})" if near else ""
    return f"{path} has the key {key}, which twin does not know{perhaps}: `twin help config` lists all keys."
