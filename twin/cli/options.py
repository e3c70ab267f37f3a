"""Options that several commands take."""

from __future__ import annotations

import getpass
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.errors import ConfigError
from twin.store.address import StoreAddress
from twin.words import Lang

if TYPE_CHECKING:
    from twin.store.store import Store

StoreOption = Annotated[
    StoreAddress,
    typer.Option(
        "--store",
        envvar="TWIN_STORE",
        parser=StoreAddress.of,
        metavar="PATH",
        help="The store: a SQLite file, or postgresql://USER@HOST/DATABASE.",
        show_default=True,
    ),
]
DEFAULT_STORE = StoreAddress("twin.db")
JsonOption = Annotated[
    bool,
    typer.Option("--json", help="Print one JSON document on stdout instead of tables; errors on stderr too."),
]
DEFAULT_SKRIV_API = "https://nvdbapiskriv.test.atlas.vegvesen.no"
"""The test environment: what changes NVDB itself is named on purpose."""
SkrivApiOption = Annotated[
    str,
    typer.Option("--api-url", envvar="TWIN_SKRIV_URL", help="API Skriv; by default its test environment."),
]
ByOption = Annotated[
    str | None,
    typer.Option(envvar="TWIN_USER", help="Who decides.  [default: the login name]", show_default=False),
]

ContactOption = Annotated[
    str | None,
    typer.Option(envvar="TWIN_CONTACT", help="Your e-mail address, sent along so that NVDB can reach you."),
]

LangOption = Annotated[
    Lang, typer.Option("--lang", envvar="TWIN_LANG", help="Language: English or Norwegian.")
]

EpsgOption = Annotated[
    int | None,
    typer.Option(
        help="Coordinate system of the file's positions: 25832 (UTM zone 32), 5972 (the same with NN2000), "
        "4258 (degrees, easting is the longitude) … "
        " [default: 25833, or its column epsg]",
        metavar="CODE",
        show_default=False,
    ),
]
PaperOption = Annotated[
    list[str] | None,
    typer.Option(
        "--paper",
        metavar="KEY=VALUE",
        help="How the paper's method is read; may be repeated. distance=rear-axle (usual), camera or ray; "
        "fov=calibrated (usual) or nominal, fov.CAMERA=DEGREES; start=antenna (usual) or rear-axle; "
        "antenna=NAME (usual: the first). "
        "More: twin help paper.",
    ),
]
WithinOption = Annotated[
    float, typer.Option(min=0, help="By position: nothing farther apart is paired.", metavar="METRES")
]
ExcelOption = Annotated[
    bool,
    typer.Option(
        "--excel", help="CSV as Norwegian Excel opens it: semicolons, decimal commas, a byte-order mark."
    ),
]


def paper_asked(texts: list[str]) -> dict[str, str]:
    """Give what ``--paper`` says, by key."""
    asked = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"--paper takes KEY=VALUE, distance=ray, but not {text:.80}.")
        asked[key.strip()] = value.strip()
    return asked


def need_csv(excel: bool, csv: Path | None) -> None:
    """Refuse ``--excel`` where no CSV is written."""
    if excel and csv is None:
        raise ConfigError("--excel says how --csv is written: name a file by --csv too.")


def need_place(files: Mapping[str, Path | None]) -> None:
    """Refuse a file whose ending belongs to another option, and make the folders of the others.

    Parameters
    ----------
    files : mapping of str to Path or None
        Option → the file that it names.
    """
    for option, path in files.items():
        fits = _ENDINGS.get("" if path is None else path.suffix.lower(), option)
        if fits != option:
            raise ConfigError(f"{option} {path}: a file with this ending is written by {fits} {path}.")
    for path in filter(None, files.values()):
        with suppress(OSError):  # whoever writes the file says why that cannot be
            path.parent.mkdir(parents=True, exist_ok=True)


_ENDINGS = {".csv": "--csv", ".xlsx": "--xlsx", ".geojson": "--geojson"}


def person(by: str | None, store: Store) -> str:
    """Return who decides: as given, or the login at the store, or at the system; "" where that knows none."""
    if by is not None:
        return by
    if store.login is not None:
        return store.login
    try:
        return getpass.getuser()
    except (ImportError, KeyError, OSError):  # without an environment, Windows knows nobody
        return ""
