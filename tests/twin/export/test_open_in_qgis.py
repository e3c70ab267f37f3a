"""``twin qgis``: how an export is opened, told and done."""

from __future__ import annotations

import time
import venv
from pathlib import Path

import pytest
from command_line import Twin
from qgis_edits import opened_as_qgis_does

from twin.export import COLUMNS
from twin.export.open_in_qgis import installed_qgis


@pytest.fixture
def exported(twin: Twin, store: Path, tmp_path: Path) -> Path:
    """An export of the sample with a project."""
    folder = tmp_path / "ut på veg"
    assert twin("export", folder, "--project", "--store", store).code == 0
    return folder


def test_qgis_says_how_to_open_the_project_and_what_is_in_it(twin: Twin, exported: Path) -> None:
    """The command to copy, a line for each layer, and how decisions come home."""
    answer = twin("qgis", exported)
    assert answer.code == 0
    address = f"geopackage:{exported.parent.as_posix()}/ut%20p%C3%A5%20veg/twin_utm33.gpkg?projectName=twin"
    assert f"qgis --project '{address}'" in answer.out
    for layer in COLUMNS:
        assert layer in answer.out
    assert "Decide in the column decision of the layer changes" in answer.err
    assert f"`twin export '{exported}'` keeps" in answer.err
    assert twin("qgis", exported / "twin_utm33.gpkg").out == answer.out
    norwegian = twin("qgis", exported, "--lang", "nb")
    assert "Hvor bilen kjørte" in norwegian.out
    assert "Avgjør i kolonnen decision" in norwegian.err


def test_qgis_as_json_has_the_same(twin: Twin, exported: Path) -> None:
    """For programs: the address, the command, rows and decisions."""
    found = twin("qgis", exported, "--json").json
    assert found["command"] == ["qgis", "--project", found["project"]]
    assert {layer["name"]: layer["rows"] for layer in found["layers"]}["changes"] == 16
    assert (found["decisions"], found["decided_in_qgis"]) == ({"open": 4}, {})


def test_qgis_counts_decisions_that_wait_in_the_file(twin: Twin, exported: Path) -> None:
    """What was decided in QGIS and not yet exported again is told."""
    with opened_as_qgis_does(exported / "twin_utm33.gpkg") as database:
        database.execute("UPDATE changes SET decision = 'dismiss' WHERE verdict = 'new'")
    found = twin("qgis", exported, "--json").json
    assert found["decisions"] == {"open": 3, "dismiss": 1}
    assert list(found["decided_in_qgis"].values()) == ["dismiss"]
    assert "1 decided in QGIS since the export" in twin("qgis", exported).err


def test_qgis_without_a_project_says_how_to_get_one(twin: Twin, store: Path, tmp_path: Path) -> None:
    """The layers can be opened all the same."""
    assert twin("export", tmp_path / "out", "--store", store).code == 0
    answer = twin("qgis", tmp_path / "out")
    assert answer.code == 0
    assert "twin_utm33.gpkg" in answer.out
    assert "geopackage:" not in answer.out
    assert f"`twin export {tmp_path / 'out'} --project` puts one in" in answer.err


@pytest.mark.parametrize(
    ("option", "said", "is_there"),
    [((), "written anew", True), (("--no-project",), "is gone", False), (("--project",), "", True)],
)
def test_a_project_does_not_go_without_a_word(
    twin: Twin, store: Path, exported: Path, option: tuple[str, ...], said: str, is_there: bool
) -> None:
    """An export to where a project stands writes it anew, unless it is told not to."""
    answer = twin("export", exported, *option, "--store", store)
    assert said in answer.err
    assert (twin("qgis", exported, "--json").json["project"] is not None) == is_there


def test_qgis_of_an_export_without_a_match_asks_for_no_decision(
    twin: Twin, trip: Path, tmp_path: Path
) -> None:
    """Where there are no findings, it says how to get some."""
    for command in (["ingest-drive", trip], ["export", tmp_path / "out"]):
        assert twin(*command, "--store", tmp_path / "new.db").code == 0
    answer = twin("qgis", tmp_path / "out")
    assert "no findings to decide about: `twin match`" in answer.err
    assert "Decide in the column" not in answer.err
    assert "Decisions" not in answer.out


def test_qgis_of_a_folder_without_an_export_says_what_to_run(twin: Twin, tmp_path: Path) -> None:
    """One sentence, and the exit code for a missing file."""
    answer = twin("qgis", tmp_path)
    assert answer.code == 4
    assert "twin export" in answer.err


def test_qgis_open_starts_the_program_with_the_project(
    twin: Twin, exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is called qgis on the search path is started, with the project's address."""
    told = tmp_path / "arguments"
    program = tmp_path / "bin" / "qgis"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nprintf "%s\\n" "$@" > "{told}.part"\nmv "{told}.part" "{told}"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:/usr/bin:/bin")
    found = twin("qgis", exported, "--open", "--json").json
    assert found["command"] == [str(program), "--project", found["project"]]
    assert _written(told).splitlines() == ["--project", found["project"]]


def test_qgis_started_from_an_activated_environment_has_its_own_python(
    twin: Twin, exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The child sees the search path and Python's variables as if no environment were active."""
    environment, told = tmp_path / "env", tmp_path / "told"
    venv.create(environment, with_pip=False)
    program = tmp_path / "bin" / "qgis"
    program.parent.mkdir()
    asked = "import os, sys; print(sys.prefix == sys.base_prefix, sys.path.count(os.environ['ELSEWHERE']))"
    program.write_text(f'#!/bin/sh\npython3 -c "{asked}" > "{told}.part"\nmv "{told}.part" "{told}"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{environment / 'bin'}:{program.parent}:/usr/bin:/bin")
    for name in ("PYTHONPATH", "ELSEWHERE"):
        monkeypatch.setenv(name, str(tmp_path))
    monkeypatch.setenv("VIRTUAL_ENV", str(environment))
    assert twin("qgis", exported, "--open").code == 0
    assert _written(told) == "True 0\n"


def _written(path: Path) -> str:
    """Wait for a file of a program that was left running: two minutes where other work has the cores."""
    for _ in range(6000):
        if path.exists():
            break
        time.sleep(0.02)
    return path.read_text()


def test_qgis_open_without_qgis_says_how_to_get_it(
    twin: Twin, exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One sentence with the cure, after all that is told of the export; it is no mistake in the command."""
    monkeypatch.setenv("PATH", str(tmp_path))
    answer = twin("qgis", exported, "--open")
    assert answer.code == 5
    assert "Layers of" in answer.out
    assert "https://qgis.org/download" in answer.err


@pytest.mark.parametrize(
    ("system", "variables", "programs"),
    [
        (
            "win32",
            {
                "ProgramFiles": "Programs",
                "PROGRAMW6432": "Programs",
                "LOCALAPPDATA": "AppData/Local",
            },
            [
                "Programs/QGIS 3.40.1/bin/qgis-ltr.bat",
                "Programs/QGIS 3.4.15/bin/qgis.bat",
                "AppData/Local/Programs/OSGeo4W/bin/qgis.bat",
            ],
        ),
        ("win32", {"SystemDrive": "."}, ["OSGeo4W64/bin/qgis.bat", "OSGeo4W/bin/qgis-qt6.bat"]),
        ("darwin", {"HOME": "."}, ["Applications/QGIS-LTR.app/Contents/MacOS/QGIS"]),
        ("linux", {"HOME": "."}, [".local/share/flatpak/exports/bin/org.qgis.qgis"]),
    ],
)
def test_qgis_is_found_where_its_installers_put_it(
    tmp_path: Path, system: str, variables: dict[str, str], programs: list[str]
) -> None:
    """The newest first; what only shares the name's beginning is not the program."""
    for name in programs:
        program = tmp_path / name
        program.parent.mkdir(parents=True, exist_ok=True)
        for file in (program.name, "qgis_process-qgis.bat", "qgis-ltr-grass8.bat", "QGIS_helper"):
            program.with_name(file).touch()
    there = {name: str(tmp_path / folder) for name, folder in variables.items()}
    assert installed_qgis(system, there) == [str(tmp_path / name) for name in programs]
