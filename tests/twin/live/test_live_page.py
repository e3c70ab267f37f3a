"""The map of a drive: what a browser shows of the lines that it hears, and who hears anything."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import requests
from playwright.sync_api import expect
from review_page import LAPTOP, chromium, open_page

from geoloc.earth.geodesy import geographic_from_utm33
from geoloc.live.causal import Following
from twin.drives.read import read_drive
from twin.live import Estimate, State, car_of
from twin.live.car_state import CarState, Health, Where
from twin.live.check import Standing, Verdict
from twin.live.sinks import Pages
from twin.live.sinks.session import session_route
from twin.web import listening
from twin.words.reasons import Told

AT_NS = 1_780_000_000_000_000_000
EAST, NORTH = 273_000.0, 7_039_200.0


@pytest.fixture
def pages(sample: Path) -> Iterator[Pages]:
    """The page of the sample's car."""
    car = car_of(read_drive(sample / "trip_trondheim"))
    one = Pages(*listening(), routes=[session_route(car, {"202": "Vikeplikt"})])
    yield one
    one.close()


def verdict(name: str, standing: Standing, was: Standing | None) -> Verdict:
    """A sign of NVDB, 2 m off."""
    return Verdict(
        *(name, standing, was, Told("…"), False, 0.97, 95, 1, "P1", ("202",), ("202",), EAST, NORTH),
        *(0.04 * np.eye(2), 2.0, 0.2, (EAST + 2.0, NORTH), AT_NS, AT_NS),
    )


def told(state: State, sigma_m: float, east_m: float = EAST) -> Estimate:
    """An estimate of the pole P1."""
    covariance = sigma_m**2 * np.eye(2)
    latitude, longitude = geographic_from_utm33(np.array([east_m]), np.array([NORTH]))
    place = float(latitude[0]), float(longitude[0]), 100.0
    return Estimate(*("P1", "P1", "", "202", "", state, *place, covariance, 0.1, 3, AT_NS, AT_NS, AT_NS))


def test_the_map_shows_what_is_said(pages: Pages) -> None:
    """The car's state in one line, each sign once with what was said last; what is withdrawn goes away."""
    where = Where(63.4106, 10.451, 100.0, 30.0, 10.0, 0.05, 0.1)
    cameras = (("C2_tricam60", Health.FINE), ("C3_tricam120", Health.LOST))
    pages.write(CarState(AT_NS, where, Following.FIXED, Health.FINE, cameras))
    pages.write(told(State.FIRST, 5.0))
    pages.write(verdict("95:1", Standing.UNCHANGED, None))
    pages.write(verdict("P2", Standing.NEW, None))
    with chromium() as browser, browser.new_context(viewport=LAPTOP, locale="nb-NO") as context:
        errors: list[str] = []
        page = open_page(context, pages.url)
        page.on("pageerror", lambda error: errors.append(str(error)))
        expect(page.locator("#state")).to_contain_text("36 km/h")
        expect(page.locator("#state strong")).to_have_text("C3_tricam120: borte")
        expect(page.locator("#map")).to_have_attribute("data-shown", "2")
        entries = page.locator("#said li")
        expect(entries).to_have_count(2)
        pages.write(told(State.REFINED, 0.2))
        pages.write(verdict("95:1", Standing.MOVED, Standing.UNCHANGED))
        pages.write(verdict("P2", Standing.WITHDRAWN, Standing.NEW))
        expect(entries).to_have_count(1)
        expect(entries).to_contain_text("202 – Vikeplikt")
        expect(entries).to_contain_text("Flyttet · 2,0 m unna · ± 0,5 m")
        pages.write(told(State.FINAL, 0.1, EAST + 0.5))
        expect(entries).to_contain_text("Flyttet · 1,5 m unna · ± 0,2 m")
        expect(page.locator("#map")).to_have_attribute("data-shown", "1")
        assert page.evaluate("twinLive.map.map.getStyle().sources.wedge.data.features.length") == 2
        assert not errors


def test_the_page_is_told_the_car_s_cameras_and_strangers_nothing(pages: Pages) -> None:
    """What a camera sees lies about where it looks; without the token's cookie there is no answer."""
    assert requests.get(f"{pages.name}/api/session", timeout=30).status_code == 403
    with requests.Session() as browser:
        browser.get(pages.url, timeout=30)
        session = browser.get(f"{pages.name}/api/session", headers={"Accept-Language": "nb"}, timeout=30)
    record = session.json()
    assert record["lang"] == "nb"
    assert record["base_map"] is None
    assert "img-src 'self' data: blob:;" in session.headers["Content-Security-Policy"]
    front = next(one for one in record["cameras"] if one["name"] == "C2_tricam60")
    assert abs(front["azimuth_deg"]) < 5.0
    assert front["half_fov_deg"] == pytest.approx(30.0, abs=3.0)
