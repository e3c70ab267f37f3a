"""An export as a whole: the same bytes for the same data, each file old or new, nothing lost."""

from __future__ import annotations

import dataclasses
import os
import pickle
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing, suppress
from pathlib import Path

import pytest
from checkout import ROOT
from qgis_edits import decide_in_qgis

from twin.errors import ExportRefusedError, TwinError
from twin.export import FILES, ExportLayers, export_all
from twin.export.folder import GEOJSON, UTM33, WGS84
from twin.export.geopackage import Answer
from twin.store.atomic_files import STAGING, replace_file, replacing

# Exports pickled layers and kills itself: at the n-th message of progress, at GDAL's n-th layer, at the n-th
# rename.
KILLED = """
import os, pathlib, pickle, signal, sys
import pyogrio
from twin.export import export_all

layers, folder, where, n = sys.argv[1:]
left = int(n)

def die_in_time(*_):
    global left
    left -= 1
    if left == 0:
        os.kill(os.getpid(), signal.SIGKILL)

def dying(function):
    def run(*args, **kwargs):
        result = function(*args, **kwargs)
        die_in_time()
        return result
    return run

if where == "layer":
    pyogrio.write_dataframe = dying(pyogrio.write_dataframe)
if where == "rename":
    pathlib.Path.replace = dying(pathlib.Path.replace)
progress = die_in_time if where == "progress" else None
export_all(pickle.loads(pathlib.Path(layers).read_bytes()), pathlib.Path(folder), progress=progress)
"""

# Exports under ever larger limits on the size of a file, as on a disk that runs full.
FULL_DISK = """
import pathlib, pickle, resource, sys
from twin.errors import ExportRefusedError
from twin.export import export_all

layers = pickle.loads(pathlib.Path(sys.argv[1]).read_bytes())
for limit in (1, 5_000, 60_000, 120_000, 180_000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        export_all(layers, pathlib.Path(sys.argv[2]))
        message = "no error"
    except ExportRefusedError as error:
        message = str(error)
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    sys.stdout.write(message.replace("\\n", " ") + "\\n")
"""


@pytest.fixture(scope="module")
def newer(layers: ExportLayers) -> ExportLayers:
    """Return the layers after another look: other reasons, one change less."""
    changes = layers.changes.assign(reason="seen again").iloc[1:]
    return dataclasses.replace(layers, changes=changes)


@pytest.fixture(scope="module")
def old(layers: ExportLayers, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the files of an export."""
    return _bytes(export_all(layers, tmp_path_factory.mktemp("old"))[0].parent)


@pytest.fixture(scope="module")
def new(newer: ExportLayers, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the files of the next export."""
    return _bytes(export_all(newer, tmp_path_factory.mktemp("new"))[0].parent)


@pytest.fixture
def folder(old: dict[str, bytes], tmp_path: Path) -> Path:
    """Return a folder that holds the old export."""
    (tmp_path / "out").mkdir()
    for name, content in old.items():
        (tmp_path / "out" / name).write_bytes(content)
    return tmp_path / "out"


def _bytes(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def _run(
    script: str, layers: ExportLayers, folder: Path, *arguments: str
) -> subprocess.CompletedProcess[str]:
    pickled = folder.parent / "layers.pickle"
    pickled.write_bytes(pickle.dumps(layers))
    return subprocess.run(
        [sys.executable, "-c", script, str(pickled), str(folder), *arguments],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


def test_export_returns_its_files_and_tells_its_progress(layers: ExportLayers, tmp_path: Path) -> None:
    """All files, in a folder that is made on the way, each named before it is written."""
    told: list[str] = []
    paths = export_all(layers, tmp_path / "new" / "folder", progress=told.append)
    assert [path.name for path in paths] == list(FILES)
    assert all(path.stat().st_size for path in paths)
    assert all(any(name in message for message in told) for name in FILES)


def test_export_of_the_same_data_is_the_same_bytes(layers: ExportLayers, tmp_path: Path) -> None:
    """Again over itself, elsewhere, and from rows in another order: not one byte differs."""
    first = _bytes(export_all(layers, tmp_path / "a")[0].parent)
    shuffled = dataclasses.replace(layers, changes=layers.changes[::-1], nvdb_signs=layers.nvdb_signs[::-1])
    for folder in ("a", "b"):
        assert _bytes(export_all(shuffled, tmp_path / folder)[0].parent) == first


def test_export_has_no_clock_in_it(layers: ExportLayers, tmp_path: Path) -> None:
    """Every time in the file's own tables is the newest of the data, not the time of writing."""
    with closing(sqlite3.connect(export_all(layers, tmp_path)[0])) as database:
        times = {
            time
            for query in (
                "SELECT last_change FROM gpkg_contents",
                "SELECT update_time FROM layer_styles",
                "SELECT timestamp FROM gpkg_metadata_reference",
            )
            for (time,) in database.execute(query)
        }
    assert times == {"2026-06-11T09:30:00.000Z"}


MOMENTS = [
    ("rename", 1),
    *(
        pytest.param(*moment, marks=pytest.mark.slow)
        for moment in (("layer", 2), ("progress", 2), ("progress", 4), ("rename", 2))
    ),
]


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="the system has no SIGKILL")
@pytest.mark.parametrize(("where", "n"), MOMENTS)
def test_killed_export_leaves_old_or_new_files(
    newer: ExportLayers, old: dict[str, bytes], new: dict[str, bytes], folder: Path, where: str, n: int
) -> None:
    """Whenever it is killed, each file is wholly old or wholly new, in order; the next export cleans up."""
    assert _run(KILLED, newer, folder, where, str(n)).returncode == -signal.SIGKILL
    left = _bytes(folder)
    assert set(left) == set(FILES)
    assert all(left[name] in (old[name], new[name]) for name in FILES)
    renamed = n if where == "rename" else 0
    # The newer export has other findings, and the same positions.
    other = [name for name in FILES if old[name] != new[name]]
    assert other == [UTM33, WGS84, GEOJSON]
    assert [name for name in other if left[name] == new[name]] == other[:renamed]
    assert (folder / STAGING).exists()
    assert _bytes(export_all(newer, folder)[0].parent) == new
    assert not (folder / STAGING).exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the size of files")
def test_export_on_a_full_disk_leaves_the_old_files(
    newer: ExportLayers, old: dict[str, bytes], folder: Path
) -> None:
    """Wherever the space ends, the export is refused in one sentence and nothing has changed."""
    done = _run(FULL_DISK, newer, folder)
    assert done.returncode == 0, done.stderr
    messages = done.stdout.splitlines()
    assert len(messages) == 5
    assert all(str(folder) in message or "could not be written" in message for message in messages)
    assert _bytes(folder) == old
    assert not (folder / STAGING).exists()


def test_export_into_a_file_is_refused(layers: ExportLayers, tmp_path: Path) -> None:
    """A file where the folder should be is named."""
    (tmp_path / "out").write_text("mine")
    for folder in (tmp_path / "out", tmp_path / "out" / "below"):
        with pytest.raises(ExportRefusedError, match="is a file: give a folder"):
            export_all(layers, folder)
    assert (tmp_path / "out").read_text() == "mine"


def test_export_where_nothing_can_be_written_is_refused(layers: ExportLayers) -> None:
    """A folder that the system does not let us make gives the reason and the cure."""
    if not Path("/proc/self").exists():
        pytest.skip("needs a file system that even root cannot write to")
    with pytest.raises(
        ExportRefusedError, match=r"cannot export to /proc/out: .* give a folder that can be written"
    ):
        export_all(layers, Path("/proc/out"))


def test_export_over_a_folder_is_refused_and_nothing_else_replaced(newer: ExportLayers, folder: Path) -> None:
    """A folder with the name of one file stops all three."""
    (folder / FILES[2]).unlink()
    (folder / FILES[2]).mkdir()
    before = _bytes(folder)
    with pytest.raises(ExportRefusedError, match="is a folder: move it away"):
        export_all(newer, folder)
    assert _bytes(folder) == before


def test_export_takes_back_what_it_replaced_when_a_later_file_fails(
    newer: ExportLayers, old: dict[str, bytes], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the third rename fails, as on Windows when the file is open, the first two are undone."""
    rename = Path.replace

    def failing(source: Path, target: Path) -> Path:
        if source.name == FILES[2]:
            raise PermissionError(13, "the file is in use")
        return rename(source, target)

    monkeypatch.setattr(Path, "replace", failing)
    with pytest.raises(ExportRefusedError, match="the file is in use; older files there are as they were"):
        export_all(newer, folder)
    assert _bytes(folder) == old


def test_export_beside_edits_not_yet_written_is_refused(newer: ExportLayers, folder: Path) -> None:
    """A write-ahead log of the old file would be applied to the new one: QGIS has to close it first."""
    (folder / f"{UTM33}-wal").write_bytes(b"edits")
    before = _bytes(folder)
    with pytest.raises(ExportRefusedError, match="close the layer in QGIS"):
        export_all(newer, folder)
    assert _bytes(folder) == before


def test_export_over_an_open_file_is_refused(
    newer: ExportLayers, new: dict[str, bytes], folder: Path
) -> None:
    """While a program has the file open in write-ahead mode, as QGIS does, it stays; afterwards it goes."""
    with closing(sqlite3.connect(folder / UTM33)) as qgis:
        qgis.execute("PRAGMA journal_mode=WAL")
        qgis.execute("SELECT * FROM changes").fetchall()
        with pytest.raises(ExportRefusedError, match="close the layer in QGIS"):
            export_all(newer, folder)
    export_all(newer, folder)
    assert _bytes(folder) == new


def test_export_over_a_left_over_index_of_a_log_goes_through(
    newer: ExportLayers, new: dict[str, bytes], folder: Path
) -> None:
    """An -shm file that nobody uses, as a crash leaves it, does not stop an export and is gone after it."""
    with closing(sqlite3.connect(folder / UTM33)) as database:
        database.execute("PRAGMA journal_mode=WAL")
    (folder / f"{UTM33}-shm").write_bytes(bytes(32768))
    export_all(newer, folder)
    assert _bytes(folder) == new


def test_two_exports_at_once_do_not_mix(layers: ExportLayers, tmp_path: Path) -> None:
    """While one export holds the folder, another is refused; what a dead one left is no hindrance."""
    (tmp_path / STAGING).mkdir()
    (tmp_path / STAGING / "left").write_bytes(b"half")
    with suppress(InterruptedError), replacing(tmp_path, FILES) as staging:
        assert not (staging / "left").exists()
        (staging / UTM33).write_bytes(b"half")
        with pytest.raises(ExportRefusedError, match="another export is writing"):
            export_all(layers, tmp_path)
        assert (staging / UTM33).read_bytes() == b"half"
        raise InterruptedError
    export_all(layers, tmp_path)
    assert {entry.name for entry in tmp_path.iterdir()} == set(FILES)


@pytest.mark.parametrize("file", [0, 1])
def test_export_does_not_lose_decisions_made_in_qgis(layers: ExportLayers, folder: Path, file: int) -> None:
    """A decision in the old file that the new data do not have stops the export; known ones do not."""
    decide_in_qgis(folder / FILES[file], "c-01", "accept")
    before = _bytes(folder)
    with pytest.raises(ExportRefusedError, match=r"holds 1 decision\(s\) made in QGIS .*c-01: accept"):
        export_all(layers, folder)
    assert _bytes(folder) == before
    decided = layers.changes.assign(decision=["open", "accept", *layers.changes["decision"][2:]])
    export_all(dataclasses.replace(layers, changes=decided), folder)


def test_export_lets_go_of_decisions_that_are_kept_elsewhere(newer: ExportLayers, folder: Path) -> None:
    """A decision on a change that the layers no longer have stops the export, unless it is known as kept."""
    decide_in_qgis(folder / UTM33, "c-00", "accept")
    for known in ({}, {"c-00": Answer("dismiss")}, {"c-01": Answer("accept")}):
        with pytest.raises(ExportRefusedError, match="c-00: accept"):
            export_all(newer, folder, known_answers=known)
    assert export_all(newer, folder, known_answers={"c-00": Answer("accept")})[0].exists()


def test_export_lets_the_store_change_its_own_decisions(layers: ExportLayers, folder: Path) -> None:
    """A decision that an export wrote and nobody touched is not in the way of another one from the store."""
    reopened = dataclasses.replace(layers, changes=layers.changes.assign(decision="open"))
    assert export_all(reopened, folder)[0].exists()


def test_export_does_not_overwrite_a_foreign_file(layers: ExportLayers, tmp_path: Path) -> None:
    """A file of that name which twin did not write stays."""
    (tmp_path / UTM33).write_bytes(b"something else")
    with pytest.raises(ExportRefusedError, match="is not an export of twin"):
        export_all(layers, tmp_path)
    assert _bytes(tmp_path) == {UTM33: b"something else"}


def test_replace_file_writes_all_or_refuses(tmp_path: Path) -> None:
    """A small file is replaced at once; where there is no folder for it, the sentence names it."""
    replace_file(tmp_path / "a.png", b"old")
    replace_file(tmp_path / "a.png", b"new")
    assert _bytes(tmp_path) == {"a.png": b"new"}
    with pytest.raises(TwinError, match=r"cannot write .*nowhere.*No such file"):
        replace_file(tmp_path / "nowhere" / "a.png", b"new")
