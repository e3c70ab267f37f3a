"""Matching on whole stores: what drives are evidence of, and how findings live over runs."""

from __future__ import annotations

import re
import shutil
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import sqlalchemy as sa
from annotation_edits import as_boxes, days_later, edit_tracks, without_tracks
from command_line import Twin
from drive_damage import frames_later
from one_road import with_road

from geoloc.locate.single_frame import ErrorBudget
from twin.errors import ConfigError, RefusedError
from twin.ingest.ingest import ingest_drive
from twin.matching import compare, found
from twin.matching.config import MatchConfig
from twin.matching.match_store import match
from twin.store import schema
from twin.store.store import Store

AS_MADE = {
    "unchanged": 12,
    "moved": 1,
    "wrong_type": 1,
    "new": 1,
    "missing": 1,
    "not_observable": 0,
    "review": 0,
}
"""What the sample was made to show (`data/README.md`)."""


def test_match_takes_absence_only_from_drives_of_its_method(synced: Path, trip: Path) -> None:
    """A complete drive ingested by `paper` alone is no evidence for a match of `single-frame`."""
    other = Path(shutil.copytree(trip, trip.with_name("other")))
    days_later(other, 1)
    without_tracks(other)
    (other / "drive.toml").write_text("annotations_complete = false\n")
    with Store.open(synced) as store:
        ingest_drive(store, trip, method="paper")
        ingest_drive(store, other, method="single-frame")
        assert match(store, method="single-frame").verdicts["missing"] == 0


def test_two_drives_place_poles_better_than_one_and_map_aided_says_what_it_did(
    synced: Path, trip: Path
) -> None:
    """The same road on two days: smaller ellipses, the same findings, also with the map's help."""
    other = Path(shutil.copytree(trip, trip.with_name("other")))
    days_later(other, 1)
    sigma_m = []
    with Store.open(synced) as store:
        for folder in (trip, other):
            ingest_drive(store, folder)
            assert match(store).verdicts == AS_MADE
            rows = store.rows(
                sa.select(schema.change.c.cov_ee_m2).where(schema.change.c.cov_ee_m2.is_not(None))
            )
            sigma_m.append(np.sqrt(np.mean([row["cov_ee_m2"] for row in rows])))
        assert sigma_m[1] < 0.9 * sigma_m[0]
        report = match(store, config=MatchConfig(map_aided=True))
    assert report.verdicts == AS_MADE
    assert report.map_aided.startswith("Map-aided: ")
    assert not report.warnings


def test_match_finds_the_same_with_ids_of_each_camera(synced: Path, trip: Path) -> None:
    """Without the attribute object, each camera has ids of its own: the findings are the same."""
    edit_tracks(trip, lambda track: re.sub(r'\s*<attribute name="object">[^<]*</attribute>', "", track))
    with Store.open(synced) as store:
        ingest_drive(store, trip)
        verdicts = match(store).verdicts
    assert verdicts == AS_MADE


def renamed(trip: Path, name: str, new: str, *, both: bool) -> None:
    """Give an object another id in the last third of its pictures; or in all, beside the first one."""

    def changed(track: str) -> str:
        if f">{name}<" not in track:
            return track
        parts = re.split(r"(?=<points )", track)
        half = 0 if both else 2 * len(parts) // 3
        anew = parts[0] + "".join(p.replace(f">{name}<", f">{new}<") for p in parts[1:][half:])
        return (track if both else "".join(parts[: half + 1]) + "</track>") + anew

    edit_tracks(trip, changed)


def test_match_takes_a_track_that_was_begun_anew_for_one_sign(synced: Path, trip: Path) -> None:
    """A pole of three plates that has another id in a third of its pictures has no new plates for that."""
    renamed(trip, "P06", "P06b", both=False)
    with Store.open(synced) as store:
        assert ingest_drive(store, trip).n_estimates == 16
        assert match(store).verdicts == AS_MADE
        keys = {row["member"].split(":")[1]: row["pole"] for row in store.rows(sa.select(schema.pole_key))}
    assert keys["P06"] == keys["P06b"]


def test_match_finds_a_second_plate_new_where_a_picture_shows_both(synced: Path, trip: Path) -> None:
    """What is marked twice in one picture hangs there twice: each plate more than NVDB has is new."""
    renamed(trip, "P06", "P06b", both=True)
    with Store.open(synced) as store:
        assert ingest_drive(store, trip).n_estimates == 16
        assert match(store).verdicts["new"] == AS_MADE["new"] + 3


def test_match_compares_the_texts_of_plates(synced: Path, trip: Path) -> None:
    """From the attribute and from NVDB's property to the finding: another text is said, and is no verdict."""
    code, text = '<attribute name="skiltnummer">404.1;906V</attribute>', ";E6 0,3 KM"
    edit_tracks(trip, lambda track: track.replace(code, f'{code}<attribute name="tekst">{text}</attribute>'))
    said, ids = {}, set()
    with Store.open(synced) as store:
        ingest_drive(store, trip)
        estimates = store.rows(sa.select(schema.estimate.c.skiltnummer, schema.estimate.c.text))
        texts = {row["skiltnummer"]: row["text"] for row in estimates if row["text"] is not None}
        for text in (None, "E6 0.3 km", "E6 500 m"):
            plates = schema.skiltplate
            with store.transaction() as connection:
                connection.execute(sa.update(plates).where(plates.c.skiltnummer == "906V").values(text=text))
                store.touch(connection)
            assert match(store).verdicts == AS_MADE
            rows = store.rows(sa.select(schema.change))
            ids.add(frozenset(row["change_id"] for row in rows))
            (said[text],) = (row for row in rows if row["skiltnummer_seen"] == "404.1;906V")
    assert texts == {"404.1;906V": ";E6 0,3 KM"}
    assert len(ids) == 1
    assert [round(row["terms"]["log_odds"]["text"], 1) for row in said.values()] == [0.0, 2.8, -2.9]
    assert [row["reason"].count('though 906V reads "E6 0,3 KM"') for row in said.values()] == [0, 0, 1]
    assert "texts" not in said[None]["terms"]
    assert said[None]["cameras"] == "C2_tricam60,C3_tricam120"


def test_match_calls_nothing_missing_where_annotations_have_no_place(synced: Path, trip: Path) -> None:
    """One frame cannot place boxes, but their signs were seen: the drive says so, and none is missing."""
    as_boxes(trip)
    with Store.open(synced) as store:
        report = ingest_drive(store, trip, method="single-frame")
        assert any("cannot show that a sign is missing" in warning for warning in report.warnings)
        assert sum(match(store).verdicts.values()) == 0


def test_match_calls_nothing_missing_without_an_annotation_file(synced: Path, trip: Path) -> None:
    """A file that holds no sign says that none was seen; where there is no file, nobody looked."""
    without_tracks(trip)
    with Store.open(synced) as store:
        ingest_drive(store, trip)
        assert match(store).verdicts["missing"] > 0
        for path in trip.glob("*.xml"):
            path.unlink()
        ingest_drive(store, trip)
        found = match(store)
    assert sum(found.verdicts.values()) == 0
    assert found.warnings == (
        "The drive trip cannot show that a sign is missing: it has no annotation file.",
    )


def test_match_asks_for_review_of_a_drive_that_does_not_fit_itself(synced: Path, trip: Path) -> None:
    """Stamps one second late are found; no difference is more than a review, and the drive is named."""
    frames_later(1.0)(trip)
    with Store.open(synced) as store:
        report = ingest_drive(store, trip)
        assert any("Do not trust the positions" in warning for warning in report.warnings)
        found = match(store)
        reasons = [row["reason"] for row in store.rows(sa.select(schema.change.c.reason))]
    assert all(found.verdicts[verdict] == 0 for verdict in ("moved", "wrong_type", "new", "missing"))
    assert (found.verdicts["unchanged"], found.verdicts["review"]) == (12, 3)
    assert any(
        re.match(r"The drive trip does not fit itself \(its camera clock .* be moved: ", reason)
        for reason in reasons
    )
    assert "does not fit itself" in found.warnings[0]


def test_match_finds_the_same_where_only_boxes_were_drawn(synced: Path, trip: Path) -> None:
    """The adjustment places boxes by where their rays cross: the findings are those of points."""
    as_boxes(trip)
    with Store.open(synced) as store:
        report = ingest_drive(store, trip)
        verdicts = match(store).verdicts
    assert report.n_estimates == 15
    assert verdicts == AS_MADE


def test_match_does_not_miss_what_was_put_up_later(opened: Store) -> None:
    """A sign that NVDB starts a year after the drive could not be seen."""
    with opened.transaction() as connection:
        connection.execute(sa.update(schema.skiltpunkt).values(start_date="2027-06-01"))
        opened.touch(connection)
    assert match(opened).verdicts["missing"] == 0


def test_match_lets_a_later_complete_drive_overrule_an_earlier_one(synced: Path, trip: Path) -> None:
    """A sign seen last year that a complete drive of today passes and does not see is missing."""
    today = Path(shutil.copytree(trip, trip.with_name("today")))
    days_later(today, 300)
    without_tracks(today, ">P07<")
    with Store.open(synced) as store:
        ingest_drive(store, trip)
        before = match(store)
        ingest_drive(store, today)
        after = match(store)
    assert (before.verdicts["moved"], before.verdicts["missing"], before.n_outdated) == (1, 1, 0)
    assert (after.verdicts["moved"], after.verdicts["missing"], after.n_outdated) == (0, 2, 1)


def test_match_of_two_drives_finds_what_one_finds(opened: Store, trip: Path) -> None:
    """A second drive over the same road doubles no sign, and keeps every change_id."""
    days_later(trip, 30)
    first = {row["change_id"]: row for row in opened.rows(sa.select(schema.change))}
    ingest_drive(opened, trip)
    match(opened)
    both = {row["change_id"]: row for row in opened.rows(sa.select(schema.change))}
    assert both.keys() == first.keys()
    seen = [row for row in both.values() if row["verdict"] != "missing"]
    assert all("," in row["drive_ids"] for row in seen)


def test_match_keeps_ids_when_an_earlier_drive_arrives_later(synced: Path, trip: Path) -> None:
    """Drives are ingested in any order: the finding keeps the id that it first got."""
    early = Path(shutil.copytree(trip, trip.with_name("early")))
    days_later(trip, 30)
    with Store.open(synced) as store:
        ingest_drive(store, trip)
        match(store)
        first = {row["change_id"] for row in store.rows(sa.select(schema.change))}
        ingest_drive(store, early)
        match(store)
        assert {row["change_id"] for row in store.rows(sa.select(schema.change))} == first


def run_of(store: Store) -> dict[str, Any]:
    """What the store keeps of its last match."""
    found = store.fact("last_match")
    assert found is not None
    return found


def test_match_hashes_every_setting_that_changes_findings(opened: Store) -> None:
    """Tolerance, gate, a prior and the method change the hash, a re-run does not; no setting is left out."""
    hashes = []
    for settings in ({}, {}, {"tolerance_m": 2.0}, {"gate_m": 10.0}, {"p_misread": 0.02}):
        match(opened, config=MatchConfig(**settings))
        hashes.append(run_of(opened)["config_sha256"])
    assert run_of(opened)["settings"]["matching"].keys() == {field.name for field in fields(MatchConfig)}
    match(opened, method="paper")
    hashes.append(run_of(opened)["config_sha256"])
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 5


def test_match_hashes_what_the_drive_says_of_itself(synced: Path, trip: Path) -> None:
    """A line of drive.toml, or another error budget, changes the hash; ingesting anew does not."""
    hashes = []
    settings = trip / "drive.toml"
    as_it_is = settings.read_text()
    with Store.open(synced) as opened:
        for line, budget in (
            ("", None),
            ("", None),
            ("pole_radius_m = 0.1\n", None),
            ("", ErrorBudget(pixel_px=3.0)),
        ):
            settings.write_text(line + as_it_is)
            ingest_drive(opened, trip, method="single-frame", budget=budget)
            match(opened)
            hashes.append(run_of(opened)["config_sha256"])
    assert hashes[0] == hashes[1]
    assert len(set(hashes)) == 3


def test_export_refuses_findings_of_an_older_state(
    twin: Twin, store: Path, trip: Path, tmp_path: Path
) -> None:
    """After another ingest the findings are stale: exported only after the next match."""
    days_later(trip, 30)
    assert twin("export", tmp_path / "out", "--store", store).code == 0
    twin("ingest-drive", trip, "--store", store)
    answer = twin("export", tmp_path / "out", "--store", store)
    assert answer.code == 5
    assert "twin match" in answer.err


@pytest.mark.parametrize(("room", "step"), [(found, "may_be_one"), (compare, "assign"), (compare, "judge")])
def test_findings_are_stale_where_nvdb_was_read_while_they_were_found(
    opened: Store, monkeypatch: pytest.MonkeyPatch, room: ModuleType, step: str
) -> None:
    """A sync that lands while a match computes: the findings are of the state before it, and are told so."""
    with opened.transaction() as connection:
        opened.touch(connection)
    work = getattr(room, step)

    def overtaken(*arguments: object, **options: object) -> object:
        with opened.transaction() as connection:
            opened.touch(connection)
        return work(*arguments, **options)

    with monkeypatch.context() as patched:
        patched.setattr(room, step, overtaken)
        match(opened)
    with pytest.raises(RefusedError, match="has changed since the last match"):
        opened.matched()
    match(opened)
    assert opened.matched()["revision"] == opened.revision()


@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_match_refuses_nonsense_settings(twin: Twin, store: Path, value: float) -> None:
    """A negative or infinite tolerance is a usage error, and the findings stay."""
    with pytest.raises(ConfigError, match="tolerance_m"):
        MatchConfig(tolerance_m=value)
    assert twin("match", "--tolerance", str(value), "--store", store).code == 2


def test_match_refuses_a_probability_above_one() -> None:
    """A share is at most 1; a distance may be anything."""
    with pytest.raises(ConfigError, match=r"p_misread of matching is 1\.5: give a share of at most 1"):
        MatchConfig(p_misread=1.5)
    assert MatchConfig(gate_m=1.5).gate_m == 1.5


def test_match_knows_by_the_road_which_side_of_a_sign_was_seen(opened: Store) -> None:
    """With the road network nothing changes, but a road metered the other way turns every plate round."""
    with_road(opened)
    with_it = match(opened).verdicts
    with opened.transaction() as connection:
        connection.execute(sa.update(schema.veglenke).values(retning=-1))
        opened.touch(connection)
    against = match(opened).verdicts
    assert with_it == AS_MADE
    assert against["missing"] == 0
    assert against["not_observable"] > 0
