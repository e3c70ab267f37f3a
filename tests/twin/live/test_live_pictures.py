"""The strip of pictures of the live map: ``make pictures`` takes it anew, of the sample in Chromium."""

from __future__ import annotations

import io
import os
from pathlib import Path

import pytest
from checkout import ROOT
from PIL import Image
from playwright.sync_api import Page, expect
from review_page import chromium, open_page

from twin.drives.read import read_drive
from twin.live import LiveEngine, State, arrivals_of, car_of
from twin.live.check import LiveCheck, MirrorAhead
from twin.live.sinks import Pages
from twin.live.sinks.session import session_route
from twin.live.watch import Watch
from twin.matching import MatchConfig
from twin.mirror.names import shipped_names
from twin.store.store import Store
from twin.web import listening

STRIP = ROOT / "docs" / "images" / "live_map.png"
pytestmark = pytest.mark.skipif(not os.environ.get("TWIN_PICTURES"), reason="TWIN_PICTURES=1 takes pictures")
SIGN = "P07"
"""A sign that was moved by 3 m since NVDB measured it."""
AFTER_S = (0.1, 1.1, 2.1, 3.4)
"""When pictures are taken, after the first frame that shows it."""
VIEW = {"width": 1000, "height": 600}
SHOWN = (0, 46, 400, 600)


def taken(page: Page) -> Image.Image:
    """The map beside the list."""
    page.wait_for_timeout(1500)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB").crop(SHOWN)


def test_strip_of_the_live_map(sample: Path, synced: Path) -> None:
    """Four moments of one approach: the ellipse shrinks, and the sign turns out to have been moved."""
    drive, pictures = read_drive(sample / "trip_trondheim"), list[Image.Image]()
    engine = LiveEngine(car_of(drive))
    pages = Pages(*listening(), routes=[session_route(engine.car, shipped_names())])
    watch, said_ns, first_ns = Watch(engine.car.antennas), 0, 0
    with (
        Store.open(synced) as store,
        chromium() as browser,
        browser.new_context(viewport=VIEW, locale="en-GB") as context,
    ):
        check = LiveCheck(engine, MirrorAhead(store, MatchConfig()), is_complete=True)
        page = open_page(context, pages.url)
        page.evaluate("document.querySelector('main').style.gridTemplateColumns = '400px 1fr'")
        page.evaluate("document.querySelector('.map-buttons').hidden = true")
        for arrival in arrivals_of(drive):
            estimates = engine.feed(arrival)
            watch.take(arrival)
            for one in [*estimates, *check.take(arrival, estimates)]:
                pages.write(one)
                if one.id == SIGN and getattr(one, "state", None) is State.FIRST:
                    first_ns = arrival.at_ns
            is_due = first_ns and arrival.at_ns - first_ns >= AFTER_S[len(pictures)] * 1e9
            if is_due or arrival.at_ns - said_ns > 250_000_000:
                said_ns = arrival.at_ns
                pages.write(watch.state(arrival.at_ns, engine))
            if is_due:
                expect(page.locator("#state")).to_contain_text("km/h")
                pictures.append(taken(page))
                if len(pictures) == len(AFTER_S):
                    break
        check.finish([])
    pages.close()
    gap, (width, height) = 6, pictures[0].size
    strip = Image.new("RGB", (len(pictures) * (width + gap) - gap, height), "white")
    for k, picture in enumerate(pictures):
        strip.paste(picture, (k * (width + gap), 0))
    strip.quantize(128, dither=Image.Dither.NONE).save(STRIP, optimize=True)
    assert 10_000 < STRIP.stat().st_size < 400_000
