"""What people set once: the keys of ``twin.toml``, beside the store and in the user's own folder.

An option stands above the environment, that above the file beside the store, that above the user's file, and
that above the built-in default.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from enum import Enum
from pathlib import Path

from twin.cli.journal import PASSWORD
from twin.cli.options import DEFAULT_STORE
from twin.errors import ConfigError
from twin.store.address import StoreAddress

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
    """One key of ``twin.toml``. It stands for every option that takes the same environment variable.

    Attributes
    ----------
    key : str
    kind : Kind
    what : str
        For people, one clause; what the documentation says.
    variable : str
        The environment variable that stands above it, ``TWIN_`` and the key unless stated.
    user_only : bool
        Whether it makes sense in the user's own file alone.
    """

    key: str
    kind: Kind
    what: str
    variable: str = ""
    user_only: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "variable", self.variable or f"TWIN_{self.key.upper()}")


SETTINGS = (
    Setting(
        "store",
        Kind.FILE,
        "the store that commands take, a path or `postgresql://…`; only in the user's own file",
        user_only=True,
    ),
    Setting("log_file", Kind.FILE, "where every command keeps its log, one JSON object a line"),
    Setting("lang", Kind.TEXT, "language: en or nb"),
    Setting("by", Kind.TEXT, "who decides, reviews and annotates", variable="TWIN_USER"),
    Setting("contact", Kind.TEXT, "e-mail address at which NVDB's staff reach you"),
    Setting("api_url", Kind.TEXT, "address of NVDB's APIs for reading"),
    Setting("source", Kind.TEXT, "which of them to mirror: les-v4 or uberiket"),
    Setting("kommune", Kind.AREA, "municipality numbers to mirror: 5001, or [5001, 5031]"),
    Setting("fylke", Kind.AREA, "county numbers to mirror"),
    Setting("kontraktsomrade", Kind.AREA, "contract areas to mirror, by name or id"),
    Setting("bbox", Kind.AREA, "box to mirror: [minE, minN, maxE, maxN] in UTM33 metres"),
    Setting("vegnett", Kind.FLAG, "whether the road network is mirrored too"),
    Setting("method", Kind.TEXT, "adjusted, single-frame or paper"),
    Setting("terrain", Kind.FILE, "ground raster (GeoTIFF)"),
    Setting("terrain_heights", Kind.TEXT, "its heights: NN2000 or ellipsoidal"),
    Setting("labels", Kind.FILE, "what labels mean, instead of a drive's labels.toml"),
    Setting("detector", Kind.FILE, "network (ONNX) that finds the signs"),
    Setting("detector_every", Kind.NUMBER, "run it on every so many frames"),
    Setting("detector_threshold", Kind.NUMBER, "lowest score of its boxes that counts"),
    Setting("tolerance", Kind.NUMBER, "metres beyond which a sign has moved"),
    Setting("match_settings", Kind.FILE, "settings of matching: the table [matching] of a TOML file"),
    Setting("map_aided", Kind.FLAG, "whether signs that NVDB has measured tie drives to the ground"),
    Setting("masker", Kind.FILE, "network (ONNX) that finds people and vehicles"),
    Setting("base_map", Kind.FLAG, "whether the review page shows Kartverket's map"),
    Setting("project", Kind.FLAG, "whether exports have a QGIS project"),
    Setting("cost_per_km", Kind.NUMBER, "your money for a kilometre driven (`twin drives --cost`)"),
    Setting("cost_per_hour", Kind.NUMBER, "your money for an hour of annotation"),
    Setting("seconds_per_mark", Kind.NUMBER, "your annotators' seconds for a point or box"),
    Setting("skriv_url", Kind.TEXT, "address of API Skriv"),
    Setting("skriv_user", Kind.TEXT, "user of API Skriv; no password"),
    Setting("skriv_realm", Kind.TEXT, "EMPLOYEE, SERVICE_ACCOUNT or EXTERNAL"),
)
"""All keys, in the order of the documentation."""

BY_KEY: Mapping[str, Setting] = {setting.key: setting for setting in SETTINGS}
BY_VARIABLE: Mapping[str, Setting] = {setting.variable: setting for setting in SETTINGS}
AREA_KEYS = ("kommune", "fylke", "kontraktsomrade", "bbox")
"""One area is named in one way: a key of them hides the others of files below."""
AREA_LISTS = ("kommune", "fylke", "kontraktsomrade")
"""Those that take several values, with commas between or each with an option of its own."""
_SECRET = ("password", "passord", "token", "secret")

Value = str | bool


@dataclass(frozen=True, slots=True)
class Held:
    """A value and the file that holds it; a path in it is taken from that file's folder."""

    value: Value
    file: Path


def user_file() -> Path:
    """Return where this user's own file is looked for, as the platform has it."""
    from platformdirs import user_config_path

    return user_config_path("twin", appauthor=False) / FILE_NAME


def store_file(store: StoreAddress) -> Path | None:
    """Return where the file beside a store is looked for; nothing is beside a database."""
    return None if store.file is None else store.file.parent / FILE_NAME


def chosen_store(option: str | None) -> StoreAddress:
    """Return the store that a command takes, before its other options are looked at."""
    named = option or os.environ.get(BY_KEY["store"].variable)
    if named:
        return StoreAddress(named)
    held = read_file(user_file(), beside_store=False).get("store")
    return DEFAULT_STORE if held is None else StoreAddress(str(held.value))


def held_settings(store: StoreAddress, tell: Callable[[str], None] | None = None) -> dict[str, Held]:
    """Return what the files hold that apply to a store, by key.

    Parameters
    ----------
    store : StoreAddress
    tell : callable, optional
        Takes what is wrong with a file, which then counts as empty.

    Raises
    ------
    ConfigError
        A file is no TOML, or has a key that twin does not know or a value that the key does not take; and
        nobody is told.
    """

    def read(path: Path, *, beside_store: bool) -> dict[str, Held]:
        try:
            return read_file(path, beside_store=beside_store)
        except ConfigError as error:
            if tell is None:
                raise
            tell(str(error))
            return {}

    users, beside = user_file(), store_file(store)
    held = read(users, beside_store=False)
    if beside is not None and beside.absolute() != users.absolute():
        above = read(beside, beside_store=True)
        if not above.keys().isdisjoint(AREA_KEYS):
            held = {key: value for key, value in held.items() if key not in AREA_KEYS}
        held |= above
    return held


def is_there(path: Path) -> bool:
    """Whether this user can see a file."""
    try:
        return path.is_file()
    except OSError:
        return False


def read_file(path: Path, *, beside_store: bool) -> dict[str, Held]:
    """Read one file; nothing where there is none.

    Raises
    ------
    ConfigError
        As :func:`held_settings`.
    """
    path = path.absolute()
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except OSError as error:
        if not _may_enter(path.parent):
            return {}  # another user's: of a store there the store itself says it
        raise ConfigError(f"The settings {path} cannot be read ({error.strerror}): mend that.") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"The settings {path} are not in UTF-8: save the file as UTF-8.") from error
    except ValueError as error:
        raise ConfigError(
            f"The settings {path} are no TOML ({error}): mend that line. A text stands in quotes, also a "
            'number that begins with 0 ("0301"); several values in brackets ([5001, 5031]); a path has / '
            "instead of \\; yes is true, and no is false."
        ) from error
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
    return value if setting.kind is Kind.TEXT else _beside(path, value)


def _beside(path: Path, value: str) -> str:
    """A path that a file names, from its folder; the address of a database as it is."""
    return value if StoreAddress(value).file is None else str(path.parent / Path(value).expanduser())


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
