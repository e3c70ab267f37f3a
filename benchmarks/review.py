"""How quick the review page is: its first view at ten thousand findings, and the server's share of an answer.

``python benchmarks/review.py`` makes a store with 10,000 findings, opens the page in the system's Chromium
(without a graphics card the processor draws the map too) and answers 100 findings by keyboard. Linux only.
"""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from review_page import LAPTOP, chromium, press, put_findings

N_FINDINGS = 10_000
N_ANSWERED = 100
FIRST_VIEW_BAR_S = 1.0
SERVER_BAR_S = 0.050
TRIES = 5


class Server:
    """``twin review`` as a process of its own."""

    def __init__(self, store: Path) -> None:
        command = [sys.executable, "-m", "twin", "review", "--store", str(store), "--no-open", "--by", "kari"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().strip()

    def processor_s(self) -> float:
        """Return the processor time that it has taken [s]: on a busy machine the wall clock tells nothing."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text("utf-8").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def end(self) -> None:
        """Stop it."""
        self.process.terminate()
        self.process.wait()


def store_with_findings(folder: Path) -> Path:
    """Make the sample's store and put the findings in."""
    if subprocess.run(
        [sys.executable, "-m", "twin", "demo", "--out", str(folder)], capture_output=True, check=False
    ).returncode:
        sys.exit("The sample cannot be made.")
    path = folder / "demo.db"
    put_findings(path, N_FINDINGS)
    return path


def main() -> None:
    """Measure, print, and exit with 1 beyond a bar."""
    folder = Path(tempfile.mkdtemp())
    path = store_with_findings(folder)
    server = Server(path)
    try:
        firsts, share = measured(server)
    finally:
        server.end()
    shutil.rmtree(folder)
    first = statistics.median(firsts)
    print(
        f"first view at {N_FINDINGS:,} findings: {first:.2f} s (median of {TRIES}; bar {FIRST_VIEW_BAR_S} s)"
    )
    bar_ms = SERVER_BAR_S * 1000
    print(f"server's time for a finding: {share * 1000:.1f} ms (mean of {N_ANSWERED}; bar {bar_ms:.0f} ms)")
    sys.exit(int(first > FIRST_VIEW_BAR_S or share > SERVER_BAR_S))


def measured(server: Server) -> tuple[list[float], float]:
    """Return how long each first view took, and the server's processor time for each finding answered [s]."""
    firsts = []
    with chromium() as browser:
        for _ in range(TRIES):
            with browser.new_context(viewport=LAPTOP) as context:
                page = context.new_page()
                begun = time.perf_counter()
                page.goto(server.url)
                page.wait_for_selector(".answer.accept")
                firsts.append(time.perf_counter() - begun)
        with browser.new_context(viewport=LAPTOP) as context:
            page = context.new_page()
            page.goto(server.url)
            page.wait_for_selector("#map[data-shown]")
            before = server.processor_s()
            for at in range(N_ANSWERED):
                press(page, "ads"[at % 3])
            page.wait_for_timeout(1000)  # What is fetched ahead and still on its way counts as well.
            share = (server.processor_s() - before) / N_ANSWERED
    return firsts, share


if __name__ == "__main__":
    main()
