"""``twin simulate``: a drive that the other commands read, its truth, and its sources of error."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest
from command_line import Twin

from geoloc.errors import GeolocError
from geoloc.simulation.noise import NoiseSpec
from geoloc.simulation.simulate import SCENARIOS
from twin.cli.samples import ScenarioName
from twin.drives.read import read_drive
from twin.errors import ConfigError, RefusedError
from twin.samples import simulation as simulate_module
from twin.samples.simulation import noise_sources, simulate


def contents(folder: Path) -> dict[str, bytes]:
    """Name → bytes of every file."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_simulated_drive_is_located_and_evaluated(twin: Twin, tmp_path: Path) -> None:
    """What simulate writes, ingest-drive reads, and evaluate knows the truth of every pole."""
    out, store = tmp_path / "trial", tmp_path / "twin.db"
    made = twin("simulate", out, "--scenario", "approach", "--speed", "30", "--seed", "5", "--json")
    assert made.code == 0
    assert (made.json["scenario"], made.json["speed_kmh"], made.json["n_objects"]) == ("approach", 30.0, 1)
    assert all(Path(path).is_file() for path in made.json["files"])
    ingested = twin("ingest-drive", out, "--store", store, "--json")
    assert ingested.json["n_annotations"] == made.json["n_sightings"]
    evaluated = twin("evaluate", out / "truth.csv", "--store", store, "--json").json["methods"]
    assert [(m["objects"]["n"], m["not_estimated"]) for m in evaluated] == [(1, [])]
    assert evaluated[0]["objects"]["max"] < 3.0


def test_table_names_the_next_commands(twin: Twin, tmp_path: Path) -> None:
    """Without --json a table says what was written, and stderr what to run next."""
    answer = twin("simulate", tmp_path / "trial", "--scenario", "approach")
    assert "truth.csv" in answer.out
    assert f"twin ingest-drive {tmp_path / 'trial'}" in answer.err


def test_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    """The drive depends on its arguments alone; another seed is another drive."""
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        simulate(tmp_path / name, name="approach", seed=seed)
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    assert contents(tmp_path / "a") != contents(tmp_path / "c")


def test_notes_state_every_source_with_value_and_reason(tmp_path: Path) -> None:
    """simulation.md lists each field of NoiseSpec as the source code explains it."""
    simulate(tmp_path / "trial", name="approach")
    notes = (tmp_path / "trial" / "simulation.md").read_text(encoding="utf-8")
    sources = noise_sources(NoiseSpec())
    assert [name for name, _, _ in sources] == [field.name for field in fields(NoiseSpec)]
    for name, value, reason in sources:
        assert len(reason) > 5, name
        assert f"| `{name}` | {value:g} | {reason} |" in notes
    assert "| `link_delay_ms` | 78 | Mean, not sigma." in notes
    assert "C3_tricam120: boresight" in notes


def test_one_antenna_and_one_camera_are_what_the_trip_holds(tmp_path: Path) -> None:
    """--antennas 1 records the left antenna alone, --cameras annotates those named."""
    report = simulate(tmp_path / "trial", name="approach", antennas=1, cameras=("C3_tricam120",))
    drive = read_drive(tmp_path / "trial")
    assert [fixes.antenna for fixes in drive.gnss] == list(report.antennas) == ["gnss50:vehicle"]
    assert set(drive.annotations.camera) == {"C3_tricam120"}
    assert len(drive.annotations.frame) == report.n_sightings > 0


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_every_scenario_can_be_read(name: str, tmp_path: Path) -> None:
    """Every scenario gives a drive with all its poles annotated somewhere or out of reach."""
    report = simulate(tmp_path / "trial", name=name, cameras=("C3_tricam120",))
    drive = read_drive(tmp_path / "trial")
    assert 0 < len(set(drive.annotations.object)) <= report.n_objects


def test_standing_drive_takes_no_speed(tmp_path: Path) -> None:
    """The scenario still has a speed of its own: another one would do nothing."""
    with pytest.raises(ConfigError, match="leave --speed out"):
        simulate(tmp_path / "trial", name="still", speed_kmh=50.0)


def test_used_folder_and_file_are_refused(twin: Twin, tmp_path: Path) -> None:
    """Nothing is written over what somebody has: exit code 5, and it stays as it was."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    (tmp_path / "file").write_text("a file")
    for name in ("mine", "file"):
        answer = twin("simulate", tmp_path / name, "--scenario", "approach")
        assert answer.code == 5
        assert answer.err.count("\n") == 1
    assert contents(tmp_path / "mine") == {"thesis.txt": b"years of work"}


def test_empty_folder_is_used(tmp_path: Path) -> None:
    """A folder that was made beforehand, and holds nothing, is as good as none."""
    (tmp_path / "trial").mkdir()
    simulate(tmp_path / "trial", name="approach")
    assert (tmp_path / "trial" / "truth.csv").is_file()


def test_failure_half_way_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that fills up after the trip was written leaves neither a folder nor its pieces."""

    def full(_drive: object) -> str:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(simulate_module, "_notes", full)
    with pytest.raises(RefusedError, match="No space left on device"):
        simulate(tmp_path / "trial", name="approach")
    assert list(tmp_path.iterdir()) == []


def test_nonsense_is_refused_in_one_sentence(twin: Twin, tmp_path: Path) -> None:
    """Unknown cameras and scenarios, speeds and antennas out of range: usage errors, and no folder."""
    out = tmp_path / "trial"
    for options in (
        ("--cameras", "C9_roof"),
        ("--scenario", "moon"),
        ("--speed", "500"),
        ("--antennas", "3"),
        ("--seed", "-1"),
    ):
        assert twin("simulate", out, *options).code == 2, options
    with pytest.raises(ConfigError, match="C1_front60Single"):
        simulate(out, cameras=("C9_roof",))
    with pytest.raises(ConfigError, match="seed"):
        simulate(out, seed=-1)
    with pytest.raises(ConfigError, match="antennas"):
        simulate(out, name="approach", antennas=0)
    with pytest.raises(GeolocError, match="km/h"):
        simulate(out, speed_kmh=500.0)
    assert list(tmp_path.iterdir()) == []


def test_scenarios_of_the_command_line_are_the_simulators() -> None:
    """The command line offers every scenario that there is."""
    assert [name.value for name in ScenarioName] == list(SCENARIOS)
