"""The annotation page's server: what is kept, what stays as it was, and what it says of poor folders."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from annotate_person import DATA, Person, browsing, sample, unannotated
from review_browser import Browser

from twin.annotate.recording import open_recording
from twin.drives.read import read_drive
from twin.errors import DriveError
from twin.samples.sample import TRIP

WIDE, TELE = "C3_tricam120", "C2_tricam60"
FILE = f"{WIDE}.annotate.xml"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The sample without annotations, a picture every half second."""
    return unannotated(tmp_path / TRIP, every=15)


@pytest.fixture
def browser(folder: Path) -> Iterator[Browser]:
    """Kari's browser."""
    with browsing(folder, by="Kari") as one:
        yield one


def a_click(**more: Any) -> dict[str, Any]:
    """A foot somewhere on the road."""
    asked = {"object": "", "camera": WIDE, "frame": 270, "kind": "foot", "place_px": [1000.0, 750.0]}
    return {**asked, **more}


def signs(browser: Browser) -> dict[str, Any]:
    """The signs of the page by their names."""
    return {one["object"]: one for one in browser.get("session")["state"]["signs"]}


def test_clicks_are_measured_and_confirmed_proposals_only_seen(folder: Path, browser: Browser) -> None:
    """What ingest-drive takes as sightings are the clicks alone; a reading by the page gives both back."""
    person = Person(browser, sample())
    name = person.annotate(4, WIDE)
    n_seen = person.confirm(4, name)
    drive, clicks = read_drive(folder), person.n_clicks[name]
    assert (len(drive.annotations.frame), len(drive.interpolated.frame)) == (clicks, n_seen)
    assert clicks <= 6
    assert n_seen > 0
    assert set(drive.annotations.object.tolist()) == {name}
    before = signs(browser)
    with browsing(folder) as again:
        after = signs(again)
    assert after[name]["marked"] == before[name]["marked"]
    assert (after[name]["n_clicks"], after[name]["n_seen"], after[name]["by"]) == (clicks, n_seen, "Kari")
    assert after[name]["sigma_m"] == pytest.approx(before[name]["sigma_m"], rel=0.01)


def test_a_box_is_drawn_and_proposed_where_the_sign_is_nearer(browser: Browser) -> None:
    """A face is proposed beside the foot, larger as the car comes nearer."""
    person = Person(browser, sample())
    name = person.click(3, "", WIDE, 270)["object"]
    x, y = person.true_px(3, WIDE, 270)[0][0]
    box = {
        "object": name,
        "camera": WIDE,
        "frame": 270,
        "kind": "box",
        "place_px": [x - 12, y - 90, x + 12, y - 66],
    }
    assert browser.post("mark", box)[0] == 200
    nearer = min(frame for frame in signs(browser)[name]["in_view"][WIDE] if frame > 270)
    proposed = {one["kind"]: one for one in browser.get(f"picture/{WIDE}/{nearer}")["proposals"]}
    left, _, right, bottom = proposed["box"]["place_px"]
    assert right - left > 24
    assert bottom < proposed["foot"]["place_px"][1]


def test_what_stood_there_is_kept_once_a_run(folder: Path) -> None:
    """A new run copies the file of the last one before it replaces it, and what others wrote meanwhile."""
    with browsing(folder) as first:
        assert first.post("mark", a_click())[1]["copies"] == []
        assert first.post("mark", a_click(frame=285))[1]["copies"] == []
    old = (folder / FILE).read_bytes()
    with browsing(folder) as second:
        (copy,) = second.post("mark", a_click(frame=300))[1]["copies"]
        assert (folder / copy).read_bytes() == old
        assert second.post("mark", a_click(frame=315))[1]["copies"] == []
        (folder / FILE).write_bytes(old)
        assert len(second.post("mark", a_click(frame=330))[1]["copies"]) == 1
    assert len(read_drive(folder).annotations.frame) == 5


def test_other_tools_files_stay_as_they_are(folder: Path) -> None:
    """Their signs are shown, can be clicked in further pictures, and their own marks are refused."""
    theirs = folder / f"{WIDE}.xml"
    theirs.write_bytes((DATA / TRIP / theirs.name).read_bytes())
    with browsing(folder) as browser:
        known = signs(browser)
        assert known["P05"]["is_foreign"]
        frame = known["P05"]["marked"][WIDE][0]
        status, told = browser.post("mark", a_click(object="P05", frame=frame - frame % 15 + 15))
        assert (status, "another tool" in told["error"]) == (409, True)
        assert browser.post("mark", a_click(object="P05", camera=TELE, frame=1425))[0] == 200
        assert not signs(browser)["P05"]["is_foreign"]
    assert theirs.read_bytes() == (DATA / TRIP / theirs.name).read_bytes()


def test_undo_leads_back_to_an_empty_page(folder: Path, browser: Browser) -> None:
    """Each change can be taken back, in the file too: of no marks there is none."""
    name = browser.post("mark", a_click())[1]["object"]
    assert browser.post("name", {"object": name, "codes": "362.50;808.1"})[0] == 200
    assert browser.post("remove", {"object": name})[1]["signs"] == []
    for n_signs in (1, 1, 0):
        status, state = browser.post("undo", {})
        assert (status, len(state["signs"])) == (200, n_signs)
    assert browser.post("undo", {})[0] == 409
    assert not (folder / FILE).exists()


def test_code_of_no_list_is_asked_about_and_kept_when_meant(folder: Path) -> None:
    """The refusal names it; the same again, as meant, stands in the file."""
    with browsing(folder, codes=frozenset({"362.50", "802"})) as browser:
        name = browser.post("mark", a_click())[1]["object"]
        assert browser.post("name", {"object": name, "codes": "362.50;802"})[0] == 200
        status, told = browser.post("name", {"object": name, "codes": "362.55;802"})
        assert (status, "362.55." in told["error"], "802" in told["error"]) == (422, True, False)
        assert signs(browser)[name]["codes"] == "362.50;802"
        assert browser.post("name", {"object": name, "codes": "362.55;802", "is_meant": True})[0] == 200
    assert "362.55;802" in (folder / FILE).read_text()


@pytest.mark.parametrize(
    ("path", "body", "status"),
    [
        ("mark", a_click(camera="../../etc"), 404),
        ("mark", a_click(frame=271), 404),
        ("mark", a_click(place_px=[5000.0, 1.0]), 400),
        ("mark", a_click(place_px=[1.0]), 400),
        ("mark", a_click(object="A999"), 409),
        ("mark", a_click(codes="<b>"), 400),
        ("mark", a_click(kind="box", place_px=[9.0, 9.0, 9.5, 9.5]), 400),
        ("confirm", {"object": "A999", "camera": WIDE, "frame": 270}, 409),
        ("name", {"object": "A999", "codes": "202"}, 409),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_written(
    folder: Path, browser: Browser, path: str, body: dict[str, Any], status: int
) -> None:
    """A wrong request gets a sentence, and the folder no file."""
    assert browser.post(path, body)[0] == status
    assert not list(folder.glob("*.annotate.xml*"))


def test_pictures_are_for_this_browser_and_no_disk(folder: Path, browser: Browser) -> None:
    """Nobody may store them; damaged ones and ones of another size are told of, and the next one comes."""
    (folder / WIDE / "000015.jpg").unlink()
    (folder / WIDE / "000015.jpg").write_bytes(b"\xff\xd8 cut")
    (folder / WIDE / "000030.jpg").unlink()
    cv2.imwrite(str(folder / WIDE / "000030.jpg"), np.zeros((60, 90, 3), np.uint8))
    answers = [
        browser.http.get(f"{browser.url}/frame/{WIDE}/{frame}.jpg", timeout=30) for frame in (0, 15, 30, 45)
    ]
    assert [one.status_code for one in answers] == [200, 409, 409, 200]
    assert "90 x 60" in answers[2].json()["error"]
    assert answers[0].headers["Cache-Control"] == "no-store"
    image = cv2.imdecode(np.frombuffer(answers[0].content, np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (1208, 1920, 3)


def test_a_drive_without_a_track_is_clicked_picture_by_picture(tmp_path: Path) -> None:
    """One sentence says that nothing is proposed; clicks are kept."""
    folder = unannotated(tmp_path / TRIP, every=150, with_track=False)
    with browsing(folder) as browser:
        (notice,) = browser.get("session")["notices"]
        assert "no place is proposed" in notice
        assert browser.post("mark", a_click(frame=150))[0] == 200
        assert browser.get(f"picture/{WIDE}/300")["proposals"] == []
    assert (folder / FILE).is_file()


def test_a_video_shorter_than_its_stamps_is_annotated_as_far_as_it_goes(tmp_path: Path) -> None:
    """The frames that are there are shown, going back too, and a sentence tells of the others."""
    folder = unannotated(tmp_path / TRIP, every=1500)
    toml = (folder / "drive.toml").read_text()
    (folder / "drive.toml").write_text(
        toml[: toml.index("[frames")] + f'[frames.{WIDE}]\nfile = "{WIDE}.mp4"\n'
    )
    video = cv2.VideoWriter(str(folder / f"{WIDE}.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30, (1920, 1208))
    for value in range(0, 80, 8):
        video.write(np.full((1208, 1920, 3), value, np.uint8))
    video.release()
    with browsing(folder) as browser:
        session = browser.get("session")
        (camera,) = session["cameras"]
        assert camera["frames"] == list(range(10))
        assert len(session["notices"]) == 1
        grey = []
        for frame in (7, 2, 9):
            answer = browser.http.get(f"{browser.url}/frame/{WIDE}/{frame}.jpg", timeout=30)
            grey.append(cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR).mean())
    assert grey == pytest.approx([56, 16, 72], abs=4)


def test_pictures_of_another_size_than_the_rigs_leave_their_camera_out(folder: Path) -> None:
    """A sentence names both sizes; the other camera goes on; with none left the folder is refused."""
    for picture in (folder / TELE).iterdir():
        picture.unlink()
    cv2.imwrite(str(folder / TELE / "000000.jpg"), np.zeros((600, 960, 3), np.uint8))
    recording = open_recording(folder)
    assert list(recording.pictures) == [WIDE]
    assert re.search("960 x 600.*1920 x 1208", recording.notices[0])
    with pytest.raises(DriveError, match="no pictures to annotate"):
        open_recording(folder, cameras=[TELE])
