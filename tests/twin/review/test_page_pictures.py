"""The pictures of the documents are taken by these tests: ``make pictures`` writes them anew."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from checkout import ROOT
from command_line import Twin
from PIL import Image
from playwright.sync_api import Page, expect
from review_browser import served
from review_page import LAPTOP, UPRIGHT, chromium, open_page, press, shown

from twin.store.store import Store

IMAGES = ROOT / "docs" / "images"
pytestmark = pytest.mark.skipif(not os.environ.get("TWIN_PICTURES"), reason="TWIN_PICTURES=1 takes pictures")


@pytest.fixture
def demo(twin: Twin, tmp_path: Path) -> Iterator[Store]:
    """The sample, done as the demo does it."""
    assert twin("demo", "--out", tmp_path / "demo-out").code == 0
    with Store.open(tmp_path / "demo-out" / "demo.db", create=False) as store:
        yield store


def to_verdict(page: Page, verdict: str) -> None:
    """Browse until a finding of the verdict is shown, with its map and pictures."""
    for _ in range(20):
        if page.evaluate("window.twinReview.finding.verdict") == verdict:
            break
        press(page, "j")
    expect(page.locator("#map")).to_have_attribute("data-shown", shown(page))
    page.wait_for_timeout(1500)


def keep(page: Page, name: str) -> None:
    """Keep what the page shows as a picture of few colours, a third of the size."""
    taken = Image.open(io.BytesIO(page.screenshot()))
    taken.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(IMAGES / f"{name}.png", optimize=True)


def test_pictures_of_the_page(demo: Store) -> None:
    """A finding, the list, the map, and a finding in Norwegian on a tablet held upright."""
    with served(demo, person="Kari Nordmann") as (address, token), chromium() as browser:
        url = address.url(token)
        with browser.new_context(viewport=LAPTOP, locale="en-GB") as context:
            page = open_page(context, url)
            to_verdict(page, "wrong_type")
            keep(page, "review")
            to_verdict(page, "moved")
            keep(page, "review_moved")
            page.keyboard.press("l")
            page.keyboard.press("?")
            expect(page.locator("#list tbody tr").first).to_be_visible()
            keep(page, "review_list")
        with browser.new_context(viewport=UPRIGHT, locale="nb-NO") as context:
            page = open_page(context, url)
            to_verdict(page, "new")
            keep(page, "review_nb")
    for name in ("review", "review_moved", "review_list", "review_nb"):
        assert (IMAGES / f"{name}.png").stat().st_size > 10_000
