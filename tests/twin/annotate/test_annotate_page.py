"""The annotation page, used in a browser over rendered pictures."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from annotate_person import DATA, Person, browsing, sample, served
from playwright.sync_api import BrowserContext, Page, expect
from review_page import LAPTOP, chromium

from geoloc.simulation.simulate import SimulatedDrive
from twin.annotate.recording import open_recording
from twin.drives.read import read_drive
from twin.samples.pictures import Studio
from twin.samples.sample import TRIP

CAMERA, SIGN = "C3_tricam120", 3
FRAMES = (270, 285, 300)


@pytest.fixture(scope="module")
def painted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample without annotations, with three pictures on the way past one sign."""
    import cv2

    folder = tmp_path_factory.mktemp("annotate") / TRIP
    (folder / CAMERA).mkdir(parents=True)
    for file in (DATA / TRIP).iterdir():
        if file.suffix != ".xml":
            shutil.copyfile(file, folder / file.name)
    with (folder / "drive.toml").open("a") as toml:
        toml.write(f'[frames.{CAMERA}]\nfile = "{CAMERA}/"\nnumbered = true\n')
    studio = Studio(sample())
    for frame in FRAMES:
        rgb = studio.picture(CAMERA, frame).rgb
        cv2.imwrite(str(folder / CAMERA / f"{frame:06d}.jpg"), rgb[..., ::-1])
    return folder


@pytest.fixture
def context() -> Iterator[BrowserContext]:
    """A person's browser."""
    with chromium() as browser, browser.new_context(viewport=LAPTOP, locale="en-GB") as one:
        yield one


@pytest.mark.slow
def test_a_sign_is_clicked_named_proposed_and_confirmed(context: BrowserContext, painted: Path) -> None:
    """Two clicks and a name make a sign; Enter confirms the third picture; no other host is asked.

    A code that no list has is asked about.
    """
    drive = sample()
    hosts: set[str] = set()
    context.on("request", lambda request: hosts.add(request.url.split("/")[2]))
    names = {"142": "Barn", "202": "Vikeplikt"}
    with served(painted, by="Kari", names=names, codes=frozenset(names)) as (address, token):
        expect.set_options(timeout=30_000)
        page = context.new_page()
        page.goto(address.url(token))
        expect(page.locator("body")).to_have_attribute("data-ready", "true")
        with browsing(painted) as other:
            person = Person(other, drive)
        click(page, person, drive, FRAMES[0])
        expect(page.locator("#signs button")).to_have_count(1)
        page.keyboard.type("999")
        page.keyboard.press("Enter")
        expect(page.locator("#said")).to_contain_text("999")
        expect(page.locator("#code")).to_be_focused()
        page.keyboard.press("Enter")
        expect(page.locator("#signs button")).to_contain_text("999")
        page.keyboard.press("k")
        expect(page.locator("#code")).to_be_focused()
        page.keyboard.type("vike")
        expect(page.locator("#codes li")).to_have_count(1)
        page.keyboard.press("Enter")
        expect(page.locator("#signs button")).to_contain_text("202 – Vikeplikt")
        page.keyboard.press("ArrowRight")
        expect(page.locator("body")).to_have_attribute("data-frame", f"{CAMERA}/{FRAMES[1]}")
        click(page, person, drive, FRAMES[1])
        expect(page.locator("#signs button")).to_contain_text("clicks: 2")
        page.keyboard.press("ArrowRight")
        expect(page.locator("body")).to_have_attribute("data-frame", f"{CAMERA}/{FRAMES[2]}")
        page.keyboard.press("Enter")
        expect(page.locator("#signs button")).to_contain_text("seen: 1")
        assert hosts == {f"{address.host}:{address.port}"}
    read = read_drive(painted)
    assert read.annotations.frame.tolist() == list(FRAMES[:2])
    assert read.interpolated.frame.tolist() == [FRAMES[2]]
    assert set(read.annotations.skiltnummer.tolist()) == {"202"}
    true_px = person.true_px(SIGN, CAMERA, np.array(FRAMES[:2]))[0]
    assert np.abs(read.annotations.pixel_px - true_px).max() < 2.0
    # Only the pictures that were there, and XML: none was written anew, whole or in part.
    assert len(list(painted.rglob("*.jpg"))) == len(FRAMES)
    assert open_recording(painted).foreign.frame.size == 0


def click(page: Page, person: Person, drive: SimulatedDrive, frame: int) -> None:
    """Click the sign's true foot in the picture on the screen."""
    box = page.locator("#canvas").bounding_box()
    assert box is not None
    model = drive.rig.camera(CAMERA).model
    scale = min(box["width"] / model.width_px, box["height"] / model.height_px)
    x, y = person.true_px(SIGN, CAMERA, frame)[0][0] + 0.5
    left = box["x"] + (box["width"] - model.width_px * scale) / 2
    top = box["y"] + (box["height"] - model.height_px * scale) / 2
    page.mouse.click(left + x * scale, top + y * scale)
