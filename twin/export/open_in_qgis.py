"""How an export is opened in QGIS: the project's address, the layers, and what to do there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from twin.errors import ExportRefusedError, FileError, RefusedError, to_type
from twin.export.folder import UTM33
from twin.export.geopackage import contents_of, edited_answers
from twin.export.layers import description
from twin.export.qgis.project import PROJECT
from twin.words import Lang

# As the packages of Linux and of OSGeo4W name it on the search path.
_PROGRAMS = ("qgis", "qgis-ltr", "qgis-bin")
# Elsewhere its installers put it beside the search path. Windows: its own installer, OSGeo4W for all and for
# one user; macOS: both folders of programs; Linux: Flatpak. ``{NAME}`` is a variable of the environment.
_PLACES: Mapping[str, tuple[str, ...]] = {
    "win32": (
        "{ProgramW6432}/QGIS*/bin/qgis*.bat",
        "{ProgramFiles}/QGIS*/bin/qgis*.bat",
        "{SystemDrive}/OSGeo4W*/bin/qgis*.bat",
        "{LOCALAPPDATA}/Programs/OSGeo4W*/bin/qgis*.bat",
    ),
    "darwin": (
        "/Applications/QGIS*.app/Contents/MacOS/QGIS*",
        "{HOME}/Applications/QGIS*.app/Contents/MacOS/QGIS*",
    ),
    "linux": (
        "/var/lib/flatpak/exports/bin/org.qgis.qgis",
        "{HOME}/.local/share/flatpak/exports/bin/org.qgis.qgis",
    ),
}
# Not ``qgis_process`` nor ``qgis-ltr-grass8.bat``, which stand beside it.
_DESKTOP = re.compile(r"(org\.qgis\.)?qgis(-ltr|-qt\d)?(\.bat)?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Layer:
    """A layer of the export: its name, its number of rows, and what a row is."""

    name: str
    rows: int
    what: str


@dataclass(frozen=True, slots=True)
class QgisExport:
    """An export as QGIS opens it.

    Attributes
    ----------
    file : Path
        The GeoPackage to decide in.
    uri : str or None
        Address of the QGIS project in it; None where it was exported without one.
    layers : tuple of Layer
        The one on top of the map first.
    decisions : mapping of decision → number of changes
        As they stand in the file.
    edited : mapping of change_id → decision
        Those that people made or commented on in QGIS since the file was written.
    """

    file: Path
    uri: str | None
    layers: tuple[Layer, ...]
    decisions: Mapping[str, int]
    edited: Mapping[str, str]

    @property
    def arguments(self) -> tuple[str, ...]:
        """What QGIS is started with."""
        return (str(self.file),) if self.uri is None else ("--project", self.uri)


def project_uri(file: Path, project: str = PROJECT) -> str:
    """Address of a project in a GeoPackage, as QGIS writes it: percent-encoded, absolute.

    Source: QGIS, ``QgsGeoPackageProjectStorage::encodeUri``.
    """
    return f"geopackage:{quote(file.resolve().as_posix(), safe='/:')}?projectName={quote(project)}"


def qgis_export(folder: Path, lang: Lang = Lang.EN) -> QgisExport:
    """Say how the export in a folder is opened, and what stands in it; what layers are in a language.

    Raises
    ------
    FileError
        There is none.
    ExportRefusedError
        It is not an export of twin.
    """
    file = folder if folder.is_file() else folder / UTM33
    if not file.exists():
        again = to_type("twin", "export", folder, "--project")
        raise FileError(f"There is no {file}: run `{again}` first.")
    found = contents_of(file)
    return QgisExport(
        file=file,
        uri=project_uri(file) if PROJECT in found.projects else None,
        layers=tuple(Layer(name, rows, description(name, lang)) for name, rows in found.rows.items()),
        decisions=found.decisions,
        edited={change: answer.decision for change, answer in edited_answers(file).items()},
    )


def has_project(folder: Path) -> bool:
    """Whether a folder holds an export with a QGIS project; what is no export has none."""
    file = folder / UTM33
    with suppress(ExportRefusedError):
        return file.is_file() and PROJECT in contents_of(file).projects
    return False


def qgis_program() -> str:
    """Find QGIS.

    Raises
    ------
    RefusedError
        It is not installed, or not where programs are looked for.
    """
    found = next(filter(None, map(shutil.which, _PROGRAMS)), None)
    found = found or next(iter(installed_qgis(sys.platform, os.environ)), None)
    if found is None:
        raise RefusedError(
            "QGIS is neither on the search path nor in its usual places: get it from"
            " https://qgis.org/download (Debian and Ubuntu: apt install qgis), 3.22 or later; or open the"
            " export from a QGIS elsewhere."
        )
    return found


def installed_qgis(system: str, variables: Mapping[str, str]) -> list[str]:
    """Programs of QGIS in the places that its installers choose, the newest version first.

    Parameters
    ----------
    system : str
        As ``sys.platform`` names it.
    variables : mapping of str to str
        The environment, which says where programs and the user's files are.
    """
    # Windows spells some of its variables in its own way, and looks them up in any.
    spelt = {name.upper(): value for name, value in variables.items()}
    found: set[Path] = set()
    for place in _PLACES.get(system, ()):
        variable = re.match(r"\{(\w+)\}/", place)
        if variable is None:
            root, pattern = Path("/"), place[1:]
        elif value := spelt.get(variable[1].upper()):
            root, pattern = Path(f"{value}/"), place[variable.end() :]
        else:
            continue
        found.update(path for path in root.glob(pattern) if _DESKTOP.fullmatch(path.name))
    return [str(path) for path in sorted(found, key=_version, reverse=True)]


def _version(program: Path) -> tuple[tuple[int, ...], str]:
    """Sort key: the version that a folder above the program names, as in ``QGIS 3.40.1``."""
    named = re.search(r"QGIS[- ]?(\d+(?:\.\d+)*)", str(program))
    return tuple(int(part) for part in named[1].split(".")) if named else (), str(program)


_PYTHON_VARIABLES = ("PYTHONHOME", "PYTHONPATH", "PYTHONEXECUTABLE", "__PYVENV_LAUNCHER__", "VIRTUAL_ENV")


def environment_for_qgis(ours: Mapping[str, str]) -> dict[str, str]:
    """Return an environment without the Python environment that is activated in it.

    QGIS runs the Python that it was built with, and takes it for that of the first ``python3`` on the search
    path: of an activated environment it would load libraries that do not fit it, and lose its own.
    """
    environment = {name: value for name, value in ours.items() if name not in _PYTHON_VARIABLES}
    if "PATH" in ours:
        folders = ours["PATH"].split(os.pathsep)
        # Programs of an environment stand one folder below the file that makes it one (PEP 405).
        kept = [folder for folder in folders if not (Path(folder).parent / "pyvenv.cfg").is_file()]
        environment["PATH"] = os.pathsep.join(kept)
    return environment


# On Windows Ctrl-C in our terminal would reach it; elsewhere a session of its own keeps it away.
_OWN_GROUP: int = getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)


def start_qgis(program: str, export: QgisExport) -> None:
    """Start QGIS with an export, and leave it running on its own, outside any Python environment."""
    process = subprocess.Popen(  # noqa: S603 - the program that the user's own search path names
        [program, *export.arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        creationflags=_OWN_GROUP,
        env=environment_for_qgis(os.environ),
    )
    # It is to outlive us: else Python warns that nobody waited for it.
    process.returncode = 0
