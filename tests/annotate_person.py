"""The annotation page's server on a copy of the sample, and a person who clicks where signs truly are."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from review_browser import Browser, browser_of

from geoloc.arrays import FloatArray
from geoloc.simulation.car import true_camera
from geoloc.simulation.motion import TrueMotion
from geoloc.simulation.observe import horizontal_range_m, project
from geoloc.simulation.road import Road
from geoloc.simulation.simulate import SimulatedDrive
from twin.annotate import AnnotateOptions, annotate_app
from twin.annotate.recording import open_recording
from twin.samples.sample import TRIP, sample_drives
from twin.web import Address, listening
from twin.web.serve import server_of

DATA = Path(__file__).parents[1] / "data"
CLICK_PX = 1.5
"""How much a hand trembles, one sigma an axis."""
FIRST_M = 14.0
"""From where a person first clicks a sign."""


@contextmanager
def served(folder: Path, **options: Any) -> Iterator[tuple[Address, str]]:
    """Serve the annotation page on loopback for the length of the block: where, and by which token."""
    listener, address = listening()
    app, token = annotate_app(open_recording(folder), AnnotateOptions(**options), address)
    server = server_of(app)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
    thread.start()
    try:
        yield address, token
    finally:
        server.should_exit = True
        thread.join()
        listener.close()


@contextmanager
def browsing(folder: Path, **options: Any) -> Iterator[Browser]:
    """Open the page of a folder without a browser's window."""
    with served(folder, **options) as (address, token):
        yield browser_of(address, token)


def unannotated(folder: Path, every: int = 3, *, with_track: bool = True) -> Path:
    """Copy the sample without its annotations, with grey pictures: the person below need not look."""
    folder.mkdir(parents=True)
    for file in sorted((DATA / TRIP).iterdir()):
        if file.suffix != ".xml" and (with_track or file.suffix != ".bin"):
            shutil.copyfile(file, folder / file.name)
    drive = sample()
    toml = (folder / "drive.toml").open("a")
    with toml:
        for camera in drive.scenario.cameras:
            toml.write(f'[frames.{camera}]\nfile = "{camera}/"\nnumbered = true\n')
            model = drive.rig.camera(camera).model
            (folder / camera).mkdir()
            first = folder / camera / "000000.jpg"
            cv2.imwrite(str(first), np.full((model.height_px, model.width_px, 3), 128, np.uint8))
            for frame in range(every, drive.frame_epoch_ns.size, every):
                os.link(first, folder / camera / f"{frame:06d}.jpg")
    return folder


@dataclass
class Person:
    """Somebody who sees where the feet of signs are, and clicks there with a trembling hand."""

    browser: Browser
    drive: SimulatedDrive
    seed: int = 0
    n_clicks: dict[str, int] = field(default_factory=dict)
    misses_px: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        world = self.drive.scenario
        self._motion = TrueMotion(
            Road(world.road, self.drive.seed), world.motion, world.noise, self.drive.seed
        )
        self._hand = np.random.default_rng(self.seed)
        self._cameras = {
            name: true_camera(self.drive.rig.camera(name), self.drive.drawn) for name in world.cameras
        }
        self.session = self.browser.get("session")
        self._frames = {one["name"]: np.array(one["frames"]) for one in self.session["cameras"]}

    def true_px(self, sign: int, camera: str, frames: Any) -> tuple[FloatArray, FloatArray]:
        """Where a sign's foot is in pictures of a camera (NaN: not in them), and how far away."""
        time_s = np.atleast_1d(frames) / self.drive.scenario.motion.frame_rate_hz
        feet = np.repeat(self.drive.objects.enu_m[sign][None], time_s.size, axis=0)
        pixel, seen = project(self.drive.scenario.noise, self._cameras[camera], self._motion, feet, time_s)
        range_m = horizontal_range_m(self._cameras[camera], self._motion, feet, time_s)
        return np.where(seen[:, None], pixel, np.nan), range_m

    def annotate(self, sign: int, camera: str, clicks: int = 6) -> str:
        """Mark one sign: where it is first seen well, then in the pictures that the page offers."""
        pixel, range_m = self.true_px(sign, camera, self._frames[camera])
        far = np.where(np.isfinite(pixel[:, 0]), np.abs(range_m - FIRST_M), np.inf)
        state = self.click(sign, "", camera, int(self._frames[camera][np.argmin(far)]))
        name: str = state["object"]
        for _ in range(clicks - 1):
            offers = next(one for one in state["signs"] if one["object"] == name)["offers"]
            if not offers:
                break
            state = self.click(sign, name, offers[0]["camera"], self.back(sign, **offers[0]))
        return name

    def back(self, sign: int, camera: str, frame: int, **_offer: float) -> int:
        """Step back from a picture that the sign has just left."""
        frames = self._frames[camera][self._frames[camera] <= frame]
        seen = np.isfinite(self.true_px(sign, camera, frames)[0][:, 0])
        return int(frames[seen][-1])

    def click(self, sign: int, name: str, camera: str, frame: int) -> Any:
        """Click a foot."""
        pixel = self.true_px(sign, camera, frame)[0][0] + self._hand.normal(scale=CLICK_PX, size=2)
        status, state = self.browser.post(
            "mark",
            {
                "object": name, "camera": camera, "frame": frame, "kind": "foot",
                "place_px": pixel.tolist(), "codes": str(self.drive.objects.skiltnummer[sign]),
            },
        )  # fmt: skip
        assert status == 200, state
        self.n_clicks[state["object"]] = self.n_clicks.get(state["object"], 0) + 1
        return state

    def confirm(self, sign: int, name: str, every: int = 1) -> int:
        """Look at the proposals of a sign in other pictures and confirm them; how many."""
        state = self.browser.get("session")["state"]
        one = next(one for one in state["signs"] if one["object"] == name)
        n = 0
        for camera, frames in one["in_view"].items():
            for frame in frames[::every]:
                if frame in one["marked"].get(camera, ()):
                    continue
                record = self.browser.get(f"picture/{camera}/{frame}")
                place = next(item for item in record["proposals"] if item["object"] == name)["place_px"]
                miss = float(np.hypot(*(self.true_px(sign, camera, frame)[0][0] - place)))
                if not np.isfinite(miss):
                    continue
                self.misses_px.append(miss)
                status, _ = self.browser.post("confirm", {"object": name, "camera": camera, "frame": frame})
                assert status == 200
                n += 1
        return n


@cache
def sample() -> SimulatedDrive:
    """The drive that the sample was simulated as; never changed."""
    return sample_drives()[TRIP]
