"""Decisions: a log that only grows, evidence that has to change really, selection in bulk, and undo."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import sqlalchemy as sa
from hypothesis import given
from hypothesis import strategies as st
from store_rows import row

from geoloc.earth.geodesy import geographic_from_utm33
from twin.decisions.evidence import Evidence, differences, present_evidence
from twin.decisions.explain import explain_change
from twin.decisions.findings import Selection, latest_findings, read_area, select, whole_ids
from twin.decisions.log import history, position
from twin.decisions.record import Edit, decide, keep_edits, undo
from twin.errors import ConfigError, FileError, RefusedError, StoreError
from twin.matching.save import save_changes
from twin.store import schema
from twin.store.records import Finding
from twin.store.store import Store

EAST, NORTH = 270_000.0, 7_041_000.0
DAY_NS = 86_400 * 10**9


PATH = shapely.to_wkb(shapely.LineString([(0.0, 0.0), (1.0, 1.0)]))


def change(change_id: str, verdict: str = "wrong_type", **values: Any) -> dict[str, Any]:
    """Make a finding about Skiltplate 7, measured to 10 cm."""
    usual = {
        "nvdb_type": 96,
        "nvdb_id": 7,
        "nvdb_version": 1,
        "skiltnummer_nvdb": "362.40",
        "skiltnummer_seen": "362.50",
        "reason": "Another plate.",
        "distance_m": 0.3,
        "distance_sigma_m": 0.1,
        "cov_ee_m2": 0.01,
        "cov_en_m2": 0.0,
        "cov_nn_m2": 0.01,
        "drive_ids": "d1",
        "east_m": EAST,
        "north_m": NORTH,
    }
    return row(schema.change, change_id=change_id, verdict=verdict, **{**usual, **values})


def new(change_id: str, **values: Any) -> dict[str, Any]:
    """Make a pole that NVDB does not have."""
    unknown = {"nvdb_type": 95, "nvdb_id": None, "nvdb_version": None, "skiltnummer_nvdb": ""}
    return change(change_id, "new", **{**unknown, "distance_m": None, "distance_sigma_m": None, **values})


def match(store: Store, *changes: dict[str, Any]) -> None:
    """Leave what a match leaves."""
    save_changes(
        store, [Finding.from_row(row) for row in changes], {}, {"method": "m", "at": "2026-06-11T00:00:00Z"}
    )


def decisions(store: Store) -> dict[str, str]:
    """Read the present decision of every finding."""
    return {one.change_id: one.decision for one in latest_findings(store.rows)}


def reason(store: Store, change_id: str) -> str:
    """Read a finding's reason as people see it."""
    return next(one.finding.reason for one in latest_findings(store.rows) if one.change_id == change_id)


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """Return a store with a plate of NVDB, two drives ten days apart and no finding."""
    with Store.open(tmp_path / "small.db") as opened:
        drives = [
            row(schema.drive, drive_id=f"d{k}", name=f"trip {k}", started_ns=t, ended_ns=t, line=PATH)
            for k, t in ((1, 0), (2, 10 * DAY_NS))
        ]
        plate = row(schema.skiltplate, nvdb_id=7, version=1, east_m=EAST, north_m=NORTH + 0.3)
        with opened.transaction() as connection:
            connection.execute(sa.insert(schema.drive), drives)
            connection.execute(sa.insert(schema.skiltplate), [plate])
        yield opened


def test_decision_is_kept_with_who_why_when_and_on_what(store: Store) -> None:
    """The log has the person, the reason, the instant in UTC, and the evidence with NVDB's position."""
    match(store, change("a"))
    before = dt.datetime.now(dt.UTC).replace(microsecond=0)
    assert decide(store, ["a"], "dismiss", by="kari", reason="road works").change_ids == ("a",)
    (entry,) = history(store.rows, "a")
    assert (entry.decision, entry.by, entry.reason) == ("dismiss", "kari", "road works")
    assert before <= dt.datetime.fromisoformat(entry.at) <= dt.datetime.now(dt.UTC)
    evidence = entry.evidence
    assert (evidence.verdict, evidence.skiltnummer_seen, evidence.nvdb_version) == ("wrong_type", "362.50", 1)
    assert (evidence.nvdb_east_m, evidence.nvdb_north_m) == (EAST, NORTH + 0.3)
    assert evidence == present_evidence(store.rows)["a"]


def test_log_can_only_grow(store: Store) -> None:
    """The database itself refuses to change or to delete an entry."""
    match(store, change("a"))
    decide(store, ["a"], "accept", by="kari")
    log = schema.decision_log
    for statement in (sa.update(log).values(decision="dismiss"), sa.delete(log)):
        with pytest.raises(StoreError, match="decisions are never"), store.transaction() as connection:
            connection.execute(statement)
    assert decisions(store) == {"a": "accept"}


def test_same_decision_again_adds_nothing(store: Store) -> None:
    """What stands already is not decided again; another reason is worth an entry."""
    match(store, change("a"))
    decide(store, ["a"], "accept", by="kari")
    again = decide(store, ["a"], "accept", by="ola")
    assert (again.change_ids, again.already) == ((), ("a",))
    decide(store, ["a"], "accept", by="ola", reason="seen it")
    assert len(history(store.rows, "a")) == 2


@pytest.mark.parametrize("decision", ["accept", "dismiss", "defer"])
def test_decision_stands_while_nothing_really_changes(store: Store, decision: str) -> None:
    """A mere re-run, or one more drive that agrees, leaves a decision and the log as they are."""
    match(store, change("a"), new("b", east_m=EAST + 50))
    decide(store, ["a", "b"], decision, by="kari")
    known = position(store.rows)
    agreeing = {"drive_ids": "d1,d2", "n_sightings": 99, "confidence": 0.7, "reason": "Another plate!"}
    for _ in range(2):
        match(store, change("a", east_m=EAST + 0.2, **agreeing), new("b", east_m=EAST + 50.1, **agreeing))
        assert decisions(store) == {"a": decision, "b": decision}
    assert position(store.rows) == known


@pytest.mark.parametrize(
    ("now", "told"),
    [
        ({"skiltnummer_seen": "362.60"}, "the sign code seen changed from 362.50 to 362.60"),
        ({"skiltnummer_seen": ""}, "the sign code seen changed from 362.50 to none"),
        ({"skiltnummer_nvdb": "362.30"}, "the sign code in NVDB changed from 362.40 to 362.30"),
        ({"nvdb_version": 2}, "NVDB's version changed from 1 to 2"),
        ({"verdict": "review"}, "the verdict changed from wrong type to review"),
        ({"east_m": EAST + 0.3}, "the measured position moved 0.30 m, out of its 95 % ellipse of then"),
    ],
)
def test_dismissed_finding_whose_evidence_changed_is_open_and_says_so(
    store: Store, now: dict[str, Any], told: str
) -> None:
    """It is open again once, its reason tells who dismissed it, when, why, and what changed since."""
    match(store, change("a"))
    decide(store, ["a"], "dismiss", by="kari", reason="road works")
    day = history(store.rows, "a")[0].at[:10]
    for _ in range(2):
        match(store, change("a", **now))
        assert decisions(store) == {"a": "open"}
        assert (
            reason(store, "a") == f"Another plate. Dismissed {day} by kari (road works); since then {told}."
        )
    assert [entry.kind for entry in history(store.rows, "a")] == ["decided", "reopened"]
    decide(store, ["a"], "dismiss", by="ola")
    assert reason(store, "a") == "Another plate."


def test_decision_holds_again_when_the_evidence_is_what_it_was(store: Store) -> None:
    """A match by another method, or a wrong annotation that is corrected, costs no decision in the end."""
    match(store, change("a"))
    decide(store, ["a"], "dismiss", by="kari", reason="road works")
    match(store, change("a", east_m=EAST + 1))
    match(store, change("a", east_m=EAST + 2))
    assert "moved 2.00 m" in reason(store, "a")
    match(store, change("a"))
    assert decisions(store) == {"a": "dismiss"}
    assert reason(store, "a") == "Another plate."
    last = history(store.rows, "a")[-1]
    assert (last.kind, last.by, last.reason) == ("carried", "kari", "road works")


def test_undo_restores_no_decision_on_other_evidence(store: Store) -> None:
    """What was decided before on other evidence is open after an undo, and says what changed."""
    match(store, change("a"))
    decide(store, ["a"], "dismiss", by="kari")
    match(store, change("a", nvdb_version=2))
    decide(store, ["a"], "accept", by="kari")
    undo(store, by="kari")
    assert decisions(store) == {"a": "open"}
    assert "since then NVDB's version changed from 1 to 2." in reason(store, "a")


def test_nvdb_that_moved_its_object_is_other_evidence(store: Store) -> None:
    """A position of NVDB that changed without a word about its version reopens too."""
    match(store, change("a"))
    decide(store, ["a"], "dismiss", by="kari")
    with store.transaction() as connection:
        connection.execute(sa.update(schema.skiltplate).values(north_m=NORTH + 2.3))
    match(store, change("a"))
    assert "since then NVDB's position moved 2.00 m." in reason(store, "a")


def test_finding_under_another_id_knows_its_forerunner(store: Store) -> None:
    """Another code seen makes another change_id: the new finding is open and tells of the dismissed one."""
    match(store, change("a"))
    decide(store, ["a"], "dismiss", by="kari")
    match(store, change("b", skiltnummer_seen="362.60"))
    assert decisions(store) == {"b": "open"}
    assert "by kari; since then the sign code seen changed from 362.50 to 362.60." in reason(store, "b")
    match(store, change("a"))
    assert decisions(store) == {"a": "dismiss"}


def test_same_finding_under_another_id_stays_dismissed(store: Store) -> None:
    """A pole whose objects were numbered anew keeps its decision; one that stands elsewhere gets none."""
    match(store, new("a"))
    decide(store, ["a"], "dismiss", by="kari", reason="private")
    match(store, new("b", east_m=EAST + 0.1), new("c", east_m=EAST + 5))
    assert decisions(store) == {"b": "dismiss", "c": "open"}
    (entry,) = history(store.rows, "b")
    assert (entry.kind, entry.by, entry.reason) == ("carried", "kari", "private")
    assert "since then" not in reason(store, "c")


def test_unchanged_sign_is_nobodys_business(store: Store) -> None:
    """What stands as NVDB has it is never open, also where the finding before it was dismissed."""
    match(store, change("a"))
    decide(store, ["a"], "dismiss", by="kari")
    match(store, change("b", "unchanged", skiltnummer_seen="362.40"))
    (one,) = latest_findings(store.rows)
    assert not one.is_open
    assert history(store.rows, "b") == []


@given(
    east=st.floats(-1, 1),
    north=st.floats(-1, 1),
    sigma=st.tuples(st.floats(0.01, 0.5), st.floats(0.01, 0.5)),
    correlation=st.floats(-0.9, 0.9),
)
def test_position_changes_beyond_the_ellipse_of_then(
    east: float, north: float, sigma: tuple[float, float], correlation: float
) -> None:
    """A move counts where its squared Mahalanobis distance exceeds 5.991, whatever the ellipse of now."""
    ee, en, nn = sigma[0] ** 2, correlation * sigma[0] * sigma[1], sigma[1] ** 2
    then = Evidence.from_row({**change("a"), "cov_ee_m2": ee, "cov_en_m2": en, "cov_nn_m2": nn})
    now = Evidence.from_row(change("a", east_m=EAST + east, north_m=NORTH + north))
    offset = np.array([now.east_m - then.east_m, now.north_m - then.north_m])
    squared = offset @ np.linalg.solve([[ee, en], [en, nn]], offset)
    if abs(squared - 5.991) > 1e-6:
        assert bool(differences(then, now)) == (squared > 5.991)


def test_undo_takes_back_commands_not_entries(store: Store) -> None:
    """A bulk decision goes back as one; going on undoing reaches further; entries only come."""
    match(store, change("a"), new("b", east_m=EAST + 50))
    decide(store, ["a"], "defer", by="kari", reason="later")
    decide(store, ["a", "b"], "accept", by="kari")
    assert undo(store, by="ola") == ("a", "b")
    assert decisions(store) == {"a": "defer", "b": "open"}
    assert [e.kind for e in history(store.rows, "a")] == ["decided", "decided", "undone"]
    assert undo(store, by="ola") == ("a",)
    assert decisions(store) == {"a": "open", "b": "open"}
    with pytest.raises(RefusedError, match=r"has 0 command\(s\) to take back, not 1"):
        undo(store, by="ola")


def test_undo_of_several_commands_goes_behind_the_first(store: Store) -> None:
    """Two commands taken back at once leave what stood before both."""
    match(store, change("a"))
    for decision in ("defer", "accept", "dismiss"):
        decide(store, ["a"], decision, by="kari")
    undo(store, 2, by="kari")
    assert decisions(store) == {"a": "defer"}
    assert history(store.rows, "a")[-1].undo_of == 2
    with pytest.raises(ConfigError, match="0 commands cannot be taken back"):
        undo(store, 0, by="kari")


def test_undo_does_not_count_what_twin_reopened(store: Store) -> None:
    """The last command of a person is taken back, however much was reopened since."""
    match(store, change("a"), new("b", east_m=EAST + 50))
    decide(store, ["b"], "accept", by="kari")
    decide(store, ["a"], "dismiss", by="kari")
    match(store, change("a", nvdb_version=2), new("b", east_m=EAST + 50))
    assert undo(store, 2, by="kari") == ("a", "b")
    assert decisions(store) == {"a": "open", "b": "open"}


def test_decide_refuses_what_it_cannot_know(store: Store) -> None:
    """An unknown change, an unknown decision, nobody's decision and stale findings change nothing."""
    with pytest.raises(StoreError, match="no findings yet"):
        decide(store, ["a"], "accept", by="kari")
    match(store, change("a"))
    with pytest.raises(ConfigError, match="found no change x, y: take an id, or at least its first 6 digits"):
        decide(store, ["a", "y", "x"], "accept", by="kari")
    with pytest.raises(ConfigError, match="'yes' is no decision: choose one of open, accept, dismiss, defer"):
        decide(store, ["a"], "yes", by="kari")
    with pytest.raises(ConfigError, match="Nobody is named"):
        decide(store, ["a"], "accept", by=" ")
    with store.transaction() as connection:
        store.touch(connection)
    with pytest.raises(RefusedError, match="run `twin match` again"):
        decide(store, ["a"], "accept", by="kari")
    assert position(store.rows) == 0


def _area(path: Path, east_m: float, north_m: float, kind: str = "FeatureCollection") -> Path:
    """Write a square of 20 m around a place."""
    corners = np.array([(-10, -10), (10, -10), (10, 10), (-10, 10), (-10, -10)])
    lat, lon = geographic_from_utm33(corners[:, 0] + east_m, corners[:, 1] + north_m)
    polygon = shapely.geometry.mapping(shapely.Polygon(np.column_stack([lon, lat])))
    feature = {"type": "Feature", "properties": {}, "geometry": polygon}
    document = {
        "FeatureCollection": {"type": "FeatureCollection", "features": [feature]},
        "Feature": feature,
        "Polygon": polygon,
        "MultiPolygon": {"type": "MultiPolygon", "coordinates": [polygon["coordinates"]]},
    }
    path.write_text(json.dumps(document[kind]), encoding="utf-8")
    return path


def test_selection_fits_every_criterion(store: Store, tmp_path: Path) -> None:
    """Verdict, class, drive, day, area and decision each narrow it; unchanged is in it by name alone."""
    match(
        store,
        change("a"),
        new("b", skiltnummer_seen="3620;808.1", east_m=EAST + 50, drive_ids="d1,d2"),
        change("c", "missing", skiltnummer_seen="", nvdb_id=8, drive_ids="d2"),
        change("u", "unchanged", nvdb_id=9),
    )
    decide(store, ["c"], "defer", by="kari")

    def ids(**criteria: Any) -> list[str]:
        return [one.change_id for one in select(store.rows, Selection(**criteria))]

    assert ids() == ["a", "b"]
    assert ids(verdicts=("new", "missing")) == ["b"]
    assert ids(classes=("362",)) == ["a"]
    assert ids(classes=("808.1",)) == ["b"]
    assert ids(classes=("36",)) == []
    assert ids(drives=("d1",)) == ["a", "b"]
    assert ids(drives=("trip 2",)) == ["b"]
    assert ids(decisions=("defer",)) == ["c"]
    assert ids(decisions=()) == ["a", "b", "c"]
    assert ids(verdicts=("unchanged",)) == ["u"]
    assert ids(since=dt.date(1970, 1, 11)) == ["b"]
    assert ids(since=dt.date(1970, 1, 12)) == []
    assert ids(until=dt.date(1970, 1, 10), verdicts=("new",)) == ["b"]
    assert ids(area=_area(tmp_path / "area.geojson", EAST, NORTH)) == ["a"]
    with pytest.raises(ConfigError, match="no drive d3: `twin drives` lists"):
        ids(drives=("d3",))


@pytest.mark.parametrize("kind", ["FeatureCollection", "Feature", "Polygon", "MultiPolygon"])
def test_area_may_be_any_geojson_with_polygons(tmp_path: Path, kind: str) -> None:
    """A collection, a feature and a bare geometry mean the same."""
    area = read_area(_area(tmp_path / "area.geojson", EAST, NORTH, kind))
    lat, lon = geographic_from_utm33([EAST, EAST + 11], [NORTH, NORTH])
    assert shapely.intersects_xy(area, lon, lat).tolist() == [True, False]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("no json", "is not GeoJSON"),
        ('{"type": "Sketch"}', "is not GeoJSON"),
        ('{"type": "Point", "coordinates": [10, 63]}', "has no polygon"),
        (
            '{"type": "Polygon", "coordinates": [[[2e5, 7e6], [3e5, 7e6], [3e5, 8e6], [2e5, 7e6]]]}',
            "is not in longitude and latitude: save it as GeoJSON in EPSG:4326",
        ),
    ],
)
def test_area_that_is_none_is_one_sentence(tmp_path: Path, text: str, told: str) -> None:
    """What cannot be an area is named with its cure."""
    path = tmp_path / "area.geojson"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=told):
        read_area(path)
    with pytest.raises(FileError, match="cannot be read"):
        read_area(tmp_path / "none.geojson")


def test_edit_on_what_has_changed_since_is_open_again(store: Store) -> None:
    """A file's decision rests on what the file said: where that is no longer so, the finding says so."""
    match(store, change("a"))
    seen = Evidence.from_row(change("a", skiltnummer_seen="362.30"))
    assert keep_edits(store, {"a": Edit("dismiss", seen, 0)}, by="kari") == ("a",)
    assert decisions(store) == {"a": "open"}
    assert "since then the sign code seen changed from 362.30 to 362.50" in reason(store, "a")


def test_edit_comes_home_once(store: Store) -> None:
    """A file that is read again does not bring back what was decided differently since."""
    match(store, change("a"))
    edit = {"a": Edit("dismiss", Evidence.from_row(change("a")), position(store.rows))}
    assert keep_edits(store, edit, by="kari") == ("a",)
    assert keep_edits(store, edit, by="kari") == ()
    undo(store, by="kari")
    assert keep_edits(store, edit, by="kari") == ()
    assert decisions(store) == {"a": "open"}
    later = {"a": Edit("dismiss", Evidence.from_row(change("a")), position(store.rows))}
    assert keep_edits(store, later, by="kari") == ("a",)


def test_ids_that_begin_alike_are_listed() -> None:
    """Nothing is guessed: the sentence says which changes fit; a whole id is always itself."""
    known = ["abcdef01", "abcdef02", "abcdef"]
    assert whole_ids(["abcdef02", "abcdef0"[:6], "abcdef02"], known) == ["abcdef02", "abcdef"]
    with pytest.raises(ConfigError, match="2 changes begin with abcdef0: write more of abcdef01, abcdef02"):
        whole_ids(["abcdef0"], known)
    assert whole_ids(["abc"], known) == ["abc"]


def test_explain_says_it_in_one_sentence(store: Store) -> None:
    """Verdict, confidence, reason and decision; of what is gone, the last decision."""
    match(store, change("a", confidence=0.93))
    assert explain_change(store, "a").sentence == (
        "a is wrong type, 93.0% sure: Another plate. Nobody has decided yet."
    )
    match(store, change("a", confidence=0.99999, terms={"log_odds": {"code": -1.6}}))
    assert explain_change(store, "a").sentence.startswith("a is wrong type, over 99.9% sure: ")
    assert explain_change(store, "a").terms == {"log_odds": {"code": -1.6}}
    decide(store, ["a"], "dismiss", by="kari", reason="road works")
    explained = explain_change(store, "a")
    day = explained.history[0].at[:10]
    assert explained.sentence.endswith(f"Decision: dismissed, {day} by kari (road works).")
    assert [drive.name for drive in explained.drives] == ["trip 1"]
    json.dumps(explained.as_json())
    match(store, new("b", east_m=EAST + 50))
    with pytest.raises(ConfigError, match=r"no longer found change a; .* dismiss, .* by kari"):
        explain_change(store, "a")
    with pytest.raises(ConfigError, match="found no change x: take an id"):
        explain_change(store, "x")
