"""What people install: the wheel, in an empty folder, without the source tree."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest
from checkout import ROOT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from twin.export.layers import COLUMNS


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built wheel, unpacked by pip into a folder of its own; its dependencies are those of the tests."""
    if not (ROOT / "pyproject.toml").exists():
        pytest.skip("the source tree is not beside the tests")
    base = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(base)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = base.glob("nvdb_twin-*.whl")
    target = base / "site"
    install = [sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--target", str(target)]
    subprocess.run([*install, str(wheel)], check=True, capture_output=True)
    return target


def _needed() -> set[str]:
    """Distributions that `pip install nvdb-twin` brings, without extras, as pyproject.toml says."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    needed: set[tuple[str, str]] = set()
    open_ends = [(Requirement(text), "") for text in project["dependencies"]]
    while open_ends:
        requirement, of_extra = open_ends.pop()
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": of_extra}):
            continue
        for extra in ("", *requirement.extras):
            one = (canonicalize_name(requirement.name), extra)
            if one not in needed:
                needed.add(one)
                said = metadata.requires(requirement.name) or []
                open_ends += [(Requirement(text), extra) for text in said]
    return {name for name, _ in needed}


ALONE = """
import sys
sys.modules.update(dict.fromkeys({hidden}))
import twin
assert "site" in twin.__file__, twin.__file__
"""
"""The start of a script in which packages of the extras and of development are hidden."""
LOCATE = """
from twin.cli import run
from twin.samples.demo import sample_folder
trip = str(sample_folder() / "trip_trondheim")
sys.exit(run(["ingest-drive", trip, "--method", "single-frame", "--store", "twin.db", "--json"]))
"""
DEMO = """
from twin.cli import run
from twin.samples import demo
run_demo, made = demo.run_demo, []

def once(*arguments, **options):
    if not made:
        made.append(run_demo(*arguments, **options))
    return made[0]

demo.run_demo = once
assert run(["demo", "--json"]) == 0
print("AS TABLES")
sys.exit(run(["demo"]))
"""


def run_alone(script: str, installed: Path, folder: Path) -> str:
    """Run a script in a folder with the wheel and its dependencies alone; what it printed."""
    needed = _needed()
    owners = metadata.packages_distributions()
    hidden = [name for name, of in owners.items() if not {canonicalize_name(one) for one in of} & needed]
    hidden = sorted(set(hidden) - {"twin", "nvdb", "geoloc"})
    assert {"av", "pytest", "rasterio", "onnxruntime"} <= set(hidden)
    done = subprocess.run(
        [sys.executable, "-c", ALONE.format(hidden=hidden) + script],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_wheel_locates_the_samples_signs_in_an_empty_folder(installed: Path, tmp_path: Path) -> None:
    """The sample travels with the wheel, which needs nothing but itself and its dependencies."""
    assert json.loads(run_alone(LOCATE, installed, tmp_path))["n_objects"] == 15


@pytest.mark.slow
def test_wheel_runs_the_demo_in_an_empty_folder(installed: Path, tmp_path: Path) -> None:
    """The whole job, half a minute: done once, and shown both ways."""
    document, tables = run_alone(DEMO, installed, tmp_path).split("AS TABLES")
    numbers = json.loads(document)
    assert numbers["verdicts"] == numbers["verdicts_expected"]
    assert all((tmp_path / path).exists() for path in numbers["files"])
    for word in (
        "signs synced",
        "drives",
        "sightings",
        "estimates",
        "moved",
        "median [m]",
        "range [m]",
        "twin_utm33.gpkg",
    ):
        assert word in tables


SCRIPT = """
import twin
from geoloc import ErrorBudget

with twin.Store("twin.db") as store:
    signs = store.estimates("adjusted")
    reveal_type(store.estimates)
    reveal_type(twin.match(store).verdicts)
    reveal_type(ErrorBudget(pixel_px=2.0).pixel_px)
    store.estimates(method=3)
    store.estimats()
"""


@pytest.mark.slow
def test_wheel_tells_a_users_mypy_its_types(installed: Path, tmp_path: Path) -> None:
    """`mypy --strict` knows methods, arguments and results of an installed twin, through its lazy names."""
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), "script.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(installed), "MYPYPATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    told = done.stdout.splitlines()
    assert len(told) == 6, done.stdout + done.stderr
    assert "def (method: str | None =) -> " in told[0]
    assert "dict[twin.store.kinds.Verdict, int]" in told[1]
    assert '"float"' in told[2]
    assert 'has incompatible type "int"; expected "str | None"' in told[3]
    assert '"Store" has no attribute "estimats"' in told[4]
    assert "Found 2 errors in 1 file" in told[5]


def test_wheel_carries_types_and_no_tests(installed: Path) -> None:
    """The three packages are typed, and nothing else is put into site-packages."""
    for package in ("twin", "nvdb", "geoloc"):
        assert (installed / package / "py.typed").exists()
    assert not (installed / "tests").exists()
    assert not (installed / "data").exists()


def test_wheel_carries_the_default_labels(installed: Path) -> None:
    """What Mapillary's labels mean in Norway travels with the package."""
    assert (installed / "twin" / "drives" / "annotations" / "labels_default.toml").exists()


def test_wheel_carries_the_qgis_styles(installed: Path) -> None:
    """One for every layer of an export."""
    styles = installed / "twin" / "export" / "qgis" / "saved_styles"
    assert {path.stem for path in styles.iterdir()} == set(COLUMNS)


def test_wheel_holds_the_pages(installed: Path) -> None:
    """Modules, sheets and the map library travel with it: a page fetches nothing from anywhere."""
    for folder in ("twin/review/static", "twin/web/static"):
        files = {path.relative_to(ROOT) for path in (ROOT / folder).rglob("*") if path.is_file()}
        assert files
        assert {path for path in files if not (installed / path).is_file()} == set()
