"""Crops of a whole store: made, made again, filled in, given up; and what bad input costs."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import pytest
import sqlalchemy as sa
from command_line import Twin

from twin.errors import ConfigError
from twin.evidence import GapKind, crop_file, crops_of, exportable_crops, forget, gaps_of, make_evidence
from twin.store import schema
from twin.store.store import Store

MOVED, MISSING = "45ca7449d96d", "e679cb267742"


def files(store: Store) -> dict[str, bytes]:
    """Every file of the evidence folder by its name."""
    return {path.name: path.read_bytes() for path in store.pictures.glob("*/*")}


def check_whole(store: Store) -> None:
    """Every row has its file, under the hash of what is in it."""
    for row in store.rows(sa.select(schema.crop.c.sha256)):
        content = crop_file(store, row["sha256"]).read_bytes()
        assert hashlib.sha256(content).hexdigest() == row["sha256"]


def test_three_views_of_each_finding_in_two_roles(made: Any) -> None:
    """From different distances or cameras, the face and its surroundings, each a small part of a frame."""
    report = made.report
    assert (report.n_findings, report.n_with_crops, report.n_crops, report.gaps) == (4, 4, 24, ())
    with Store.open(made.store) as store:
        check_whole(store)
        for change_id in (MOVED, MISSING):
            found = crops_of(store.rows, change_id)
            assert [(c.number, c.role.value) for c in found] == [
                (number, role) for number in range(3) for role in ("face", "wide")
            ]
            assert len({(c.camera, round(c.range_m)) for c in found}) == 3
            assert all(c.is_masked and c.proof.of_frame <= 0.2 for c in found)
            assert all(c.range_m < 20.0 and c.frame % 12 == 0 for c in found)


def test_second_run_makes_the_same_files_and_nothing_new(filmed: Any) -> None:
    """Byte for byte; and --missing has nothing to do."""
    filmed.only(MOVED)
    with Store.open(filmed.store) as store:
        assert make_evidence(store).n_new_files == 6
        before = files(store)
        again = make_evidence(store)
        assert (again.n_new_files, again.n_deleted_files, files(store)) == (0, 0, before)
        assert make_evidence(store, missing_only=True).n_findings == 0


def test_drive_whose_pictures_come_later_is_filled_in(filmed: Any, sample: Path) -> None:
    """A drive without pictures says so, as does one whose folder is gone; then --missing fills in."""
    filmed.only(MOVED)
    for folder, kind, said in (
        (sample / "trip_trondheim", GapKind.NO_PICTURES, "has no pictures"),
        (filmed.folder.parent / "gone", GapKind.FOLDER_GONE, "is not there"),
    ):
        filmed.point_to(folder)
        with Store.open(filmed.store) as store:
            assert make_evidence(store, missing_only=True).n_with_crops == 0
            (gap,) = gaps_of(store.rows, MOVED)
            assert gap.kind is kind
            assert said in gap.sentence
    filmed.point_to(filmed.folder)
    with Store.open(filmed.store) as store:
        assert make_evidence(store, missing_only=True).n_with_crops == 1
        assert gaps_of(store.rows, MOVED) == ()
    filmed.point_to(filmed.folder.parent / "gone")
    with Store.open(filmed.store) as store:
        # What was made is kept while the disk with the pictures is away.
        assert make_evidence(store).n_with_crops == 1
        assert len(crops_of(store.rows, MOVED)) == 6


def test_damaged_pictures_and_such_of_another_size_are_told_and_the_rest_goes_on(own: Any) -> None:
    """One camera's pictures are cut short, the other's are of another size near one finding alone."""
    own.only(MOVED, MISSING)
    for path in (own.folder / "C3_tricam120").iterdir():
        path.write_bytes(path.read_bytes()[:1000])
    for number in (504, 516, 528, 540):
        path = own.folder / "C2_tricam60" / f"{number:06d}.jpg"
        cv2.imwrite(str(path), cv2.imread(str(path))[::2, ::2])
    with Store.open(own.store) as store:
        report = make_evidence(store)
        assert report.n_with_crops == 1
        assert {gap.kind for gap in gaps_of(store.rows, MOVED)} == {GapKind.FRAME_LOST, GapKind.OTHER_SIZE}
        found = crops_of(store.rows, MISSING)
        assert {c.camera for c in found} == {"C2_tricam60"}
        assert [c.number for c in found] == [0, 0, 1, 1]
        check_whole(store)


def test_pictures_that_cannot_be_opened_are_a_gap(own: Any) -> None:
    """drive.toml names a video that is none: a sentence, no crop, no error."""
    own.only(MOVED)
    text = (own.folder / "drive.toml").read_text()
    (own.folder / "broken.mp4").write_bytes(b"<html>")
    (own.folder / "drive.toml").write_text(
        text.replace("numbered = true", "").replace('file = "C', 'file = "broken.mp4" # "C')
    )
    with Store.open(own.store) as store:
        assert make_evidence(store).n_with_crops == 0
        assert any("web page" in gap.sentence for gap in gaps_of(store.rows, MOVED))


def test_file_without_a_row_is_deleted_and_so_are_crops_of_findings_that_are_gone(made: Any) -> None:
    """Nothing is kept that no finding needs."""
    with Store.open(made.store) as store:
        stray = store.pictures / "ab" / f"{'ab' * 32}.webp"
        stray.parent.mkdir(exist_ok=True)
        stray.write_bytes(b"left by a killed run")
        with store.transaction() as connection:
            connection.execute(sa.delete(schema.change).where(schema.change.c.change_id == MOVED))
        n_before = len(files(store))
        make_evidence(store, missing_only=True)
        assert (crops_of(store.rows, MOVED), stray.exists()) == ((), False)
        assert len(files(store)) == n_before - 7
        check_whole(store)


@pytest.mark.slow
def test_killed_run_leaves_no_row_without_its_file(filmed: Any) -> None:
    """Killed while files are written: the rows of before hold, and the next run clears up and completes."""
    command = [sys.executable, "-m", "twin", "evidence", "--store", str(filmed.store)]
    filmed.only(MOVED, MISSING)
    with Store.open(filmed.store) as store:
        for n_files in (1, 5):
            with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
                # Names alone: a file still under its temporary name may be renamed before it could be read.
                while process.poll() is None and len(list(store.pictures.glob("*/*"))) < n_files:
                    time.sleep(0.005)
                process.send_signal(signal.SIGKILL)
            check_whole(store)
        assert make_evidence(store).n_with_crops == 2
        check_whole(store)
        assert len(files(store)) == 12


def test_unmasked_crops_need_a_reason_are_logged_and_never_leave(filmed: Any) -> None:
    """They are the frame's own pixels, said to be so, and no export gets them; the log cannot be changed."""
    filmed.only(MOVED)
    with Store.open(filmed.store) as store:
        for reason, by in (("", "kari"), ("court case", ""), ("court case", None)):
            with pytest.raises(ConfigError, match="reason and a name"):
                make_evidence(store, unmasked_reason=reason, by=by)
        report = make_evidence(store, unmasked_reason="court case", by="kari")
        assert (report.masker, exportable_crops(store.rows)) == ("none", ())
        crop = crops_of(store.rows, MOVED)[0]
        assert (crop.is_masked, crop.proof.masker, crop.proof.share_clear) == (False, "none", 1.0)
        left, top, right, low = crop.proof.place_px
        shown = cv2.imread(str(crop_file(store, crop.sha256)))[..., ::-1]
        assert (shown == filmed.frame(crop.camera, crop.frame)[top:low, left:right]).all()
        (entry,) = store.rows(sa.select(schema.crop_log))
        assert (entry["kind"], entry["by"], entry["reason"], entry["n_crops"]) == (
            *("unmasked", "kari", "court case"),
            6,
        )
        for change in (sa.delete(schema.crop_log), sa.update(schema.crop_log).values(by="x")):
            with pytest.raises(Exception, match="never changed"), store.transaction() as connection:
                connection.execute(change)
        make_evidence(store)
        assert len(exportable_crops(store.rows)) == 6


def test_forgetting_deletes_rows_and_files_and_says_what(made: Any) -> None:
    """By the day that the pictures were taken, 2026-06-10."""
    with Store.open(made.store) as store:
        crop = crops_of(store.rows, MOVED)[0]
        path = crop_file(store, crop.sha256)
        kept = forget(store, dt.date(2026, 6, 10))
        assert (kept.n_crops, kept.n_files, len(files(store))) == (0, 0, 24)
        gone = forget(store, dt.date(2026, 6, 11), by="kari")
        assert (gone.n_crops, gone.n_files, gone.drives) == (24, 24, ("trip_trondheim",))
        assert (len(gone.change_ids), files(store), path.exists()) == (4, {}, False)
        with pytest.raises(ConfigError, match="no crop"):
            crop_file(store, crop.sha256)
        (entry,) = store.rows(sa.select(schema.crop_log))
        assert (entry["kind"], entry["by"], entry["n_crops"]) == ("forgotten", "kari", 24)


@pytest.mark.parametrize("sha256", ["../../twin", "0" * 64, "", "a" * 63 + "/"])
def test_file_of_what_is_no_crop_is_refused(filmed: Any, sha256: str) -> None:
    """No path comes from outside."""
    with Store.open(filmed.store) as store, pytest.raises(ConfigError, match="no crop"):
        crop_file(store, sha256)


def test_command_says_what_it_made_and_deleted(twin: Twin, filmed: Any) -> None:
    """In a sentence, and as JSON."""
    filmed.only(MOVED)
    store = ["--store", str(filmed.store)]
    made = twin("evidence", *store, "--json")
    assert json.loads(made.out)["n_with_crops"] == 1
    told = twin("evidence", "--missing", *store)
    assert (told.code, "No finding lacks pictures" in told.err) == (0, True)
    gone = twin("evidence", "--forget", "--older-than", "2026-06-11", *store)
    assert "Deleted 6 pictures of trip_trondheim that were taken before 2026-06-11" in gone.err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--unmasked"], "need --reason and --by"),
        (["--reason", "x"], "--unmasked or --forget"),
        (["--forget"], "belong together"),
        (["--older-than", "3"], "belong together"),
        (["--forget", "--older-than", "soon"], "neither days nor a date"),
        (["--forget", "--older-than", "3", "--missing"], "belong together"),
        (["--masker", "none.onnx"], "cannot be read"),
    ],
)
def test_options_that_do_not_fit_are_told(
    twin: Twin, filmed: Any, options: list[str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One sentence with the cure; nothing is made."""
    monkeypatch.delenv("TWIN_USER", raising=False)
    answer = twin("evidence", *options, "--store", filmed.store)
    assert answer.code in (2, 4)
    assert said in answer.err
    assert not filmed.store.with_name("twin.db.evidence").exists()
