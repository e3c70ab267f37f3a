"""How quick the review page is: its first view at ten thousand findings, and the server's share of an answer.

``python benchmarks/review.py`` makes a store with 10,000 findings, opens the page in the system's Chromium
(without a graphics card here: the processor draws the map too) and answers 100 findings by keyboard.
"""

from __future__ import annotations

import shutil
import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from review_page import LAPTOP, chromium, press, put_findings

from twin.cli import run
from twin.review.app import ReviewOptions, review_app
from twin.store.store import Store
from twin.web.serve import listening, server_of

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Receive, Scope, Send

N_FINDINGS = 10_000
N_ANSWERED = 100
FIRST_VIEW_BAR_S = 1.0
SERVER_BAR_S = 0.050
TRIES = 5


class Timed:
    """An application, and how long it took over all requests."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self.seconds = 0.0
        self.requests = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, and add the time."""
        begun = time.perf_counter()
        await self.app(scope, receive, send)
        self.seconds += time.perf_counter() - begun
        self.requests += 1


def store_with_findings(folder: Path) -> Path:
    """Make the sample's store and put the findings in."""
    if run(["demo", "--out", str(folder), "--json"]) != 0:
        sys.exit("The sample cannot be made.")
    path = folder / "demo.db"
    put_findings(path, N_FINDINGS)
    return path


def main() -> None:
    """Measure, print, and exit with 1 beyond a bar."""
    folder = Path(tempfile.mkdtemp())
    path = store_with_findings(folder)
    listener, address = listening()
    with Store.open(path, create=False) as store:
        app, token = review_app(store, ReviewOptions(person="kari"), address)
        timed = Timed(app)
        server = server_of(timed)
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            firsts, shares = measured(address.url(token), timed)
        finally:
            server.should_exit = True
            thread.join()
    shutil.rmtree(folder)
    first, share = statistics.median(firsts), statistics.mean(shares)
    print(
        f"first view at {N_FINDINGS:,} findings: {first:.2f} s (median of {TRIES}; bar {FIRST_VIEW_BAR_S} s)"
    )
    print(
        f"server's share of a finding: {share * 1000:.1f} ms (mean of {N_ANSWERED}; bar {SERVER_BAR_S * 1000:.0f} ms)"
    )
    sys.exit(int(first > FIRST_VIEW_BAR_S or share > SERVER_BAR_S))


def measured(url: str, timed: Timed) -> tuple[list[float], list[float]]:
    """Return how long each first view took, and the server's time for each finding that was answered [s]."""
    firsts, shares = [], []
    with chromium() as browser:
        for _ in range(TRIES):
            with browser.new_context(viewport=LAPTOP) as context:
                page = context.new_page()
                begun = time.perf_counter()
                page.goto(url)
                page.wait_for_selector(".answer.accept")
                firsts.append(time.perf_counter() - begun)
        with browser.new_context(viewport=LAPTOP) as context:
            page = context.new_page()
            page.goto(url)
            page.wait_for_selector("#map[data-shown]")
            for at in range(N_ANSWERED):
                before = timed.seconds
                press(page, "ads"[at % 3])
                page.wait_for_timeout(50)  # What is fetched ahead counts as well.
                shares.append(timed.seconds - before)
    return firsts, shares


if __name__ == "__main__":
    main()
