"""The review page in a real browser, as a person at a keyboard has it."""

from __future__ import annotations

import random
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import sqlalchemy as sa
from playwright.sync_api import Browser, BrowserContext, Page, ViewportSize, expect, sync_playwright
from store_rows import row

from twin.store import schema
from twin.store.store import Store

CHROMIUM = shutil.which("chromium")
LAPTOP: ViewportSize = {"width": 1280, "height": 800}
TABLET: ViewportSize = {"width": 1024, "height": 768}
UPRIGHT: ViewportSize = {"width": 820, "height": 1180}
# The map is drawn by the processor: machines for tests have no graphics card.
_OPTIONS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_PATIENCE_MS = 60_000


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start the system's Chromium; without it the test is skipped."""
    if CHROMIUM is None:
        pytest.skip("no chromium on this machine (Debian: apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=_OPTIONS)
        yield browser
        browser.close()


def open_page(context: BrowserContext, url: str, name: str = "") -> Page:
    """Open the address that ``twin review`` printed, and say who one is where the page asks."""
    expect.set_options(timeout=_PATIENCE_MS)
    context.set_default_timeout(_PATIENCE_MS)
    page = context.new_page()
    page.goto(url)
    expect(page.locator("body")).to_have_attribute("data-ready", "true")
    if name:
        page.fill("#name", name)
        page.keyboard.press("Enter")
        expect(page.locator(".answer.accept")).to_be_visible()
    return page


def shown(page: Page) -> str:
    """Return the change id of the finding on the screen."""
    return page.locator("#finding").get_attribute("data-change-id") or ""


def press(page: Page, key: str) -> None:
    """Press a key and wait until another finding is shown, or none is left."""
    before = shown(page)
    page.keyboard.press(key)
    expect(page.locator(f'#finding[data-change-id="{before}"]:not(:has(.end))')).to_have_count(0)


def log_of(path: Path) -> list[tuple[str, str, str, str]]:
    """Return the log of decisions: finding, decision, person, comment."""
    log = schema.decision_log.c
    with Store.open(path) as store:
        rows = store.rows(sa.select(schema.decision_log).order_by(log.id))
    return [(one["change_id"], one["decision"], one["by"], one["reason"]) for one in rows]


def put_findings(path: Path, n: int) -> Sequence[str]:
    """Put `n` new signs along a road into the store, as a match leaves them."""
    rows = [
        row(
            schema.change, change_id=f"{at:012x}", verdict=("new", "missing", "moved", "wrong_type")[at % 4],
            reason="It stands here.", confidence=0.9, nvdb_type=95, skiltnummer_seen="202", terms={},
            east_m=270_000.0 + 7.0 * (at % 1000), north_m=7_041_000.0 + 40.0 * (at // 1000),
        )
        for at in range(n)
    ]  # fmt: skip
    with Store.open(path) as store, store.transaction() as connection:
        connection.execute(sa.delete(schema.change))
        connection.execute(sa.insert(schema.change), rows)
    return [one["change_id"] for one in rows]


@contextmanager
def running(store: Path, port: int, *options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``twin review`` as a process of its own, and the address that it prints."""
    command = [
        sys.executable,
        "-m",
        "twin",
        "review",
        "--store",
        str(store),
        "--no-open",
        "--port",
        str(port),
        *options,
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        yield process, process.stdout.readline().strip()
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def free_port() -> int:
    """Return a port that nobody listens on, and that the system gives nobody who asks for any."""
    for port in random.sample(range(20_000, 30_000), 100):
        with socket.socket() as one, suppress(OSError):
            one.bind(("127.0.0.1", port))
            return port
    pytest.fail("a hundred ports below those that the system gives away are taken")
