"""``twin show --frame`` and ``--video``: everything that is known, drawn into the pictures of a drive."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from twin.cli.output import note
from twin.errors import ConfigError
from twin.store.address import StoreAddress
from twin.words import Lang, say

if TYPE_CHECKING:
    from twin.overlay.make import Asked
    from twin.overlay.scene import DriveScene
    from twin.store.store import Store

NEAREST = "nearest"


@dataclass(frozen=True, slots=True)
class Wish:
    """What the command line asks for."""

    frame: str | None
    out: Path | None
    video: Path | None
    camera: str | None
    masker: Path | None
    is_masked: bool
    lang: Lang


def show_pictures(which: str, wish: Wish, store: StoreAddress, *, quiet: bool) -> list[Path]:
    """Write the picture, the film or both, and return what was written.

    Raises
    ------
    ConfigError
        The wish contradicts itself, or names what is not there.
    """
    from twin.overlay.make import FILMS, PICTURES, check_name, write_film, write_picture
    from twin.overlay.scene import scene_of
    from twin.store.store import Store

    if wish.frame is not None and wish.out is None:
        raise ConfigError("--frame needs a file to draw into: add --out FILE.png.")
    if wish.frame is None and wish.out is not None:
        raise ConfigError("--out belongs to --frame; --video names its own file: leave one of them out.")
    if wish.masker is not None and not wish.is_masked:
        raise ConfigError("--masker and --unmasked contradict one another: give one of them.")
    # What cannot be written is said before minutes of drawing.
    for path, endings in ((wish.out, PICTURES), (wish.video, FILMS)):
        if path is not None:
            check_name(path, endings)
    with Store.open(store, create=False) as opened:
        scene, name = scene_of(opened, _estimate_of(opened, which))
    written = []
    if wish.frame is not None and wish.out is not None:
        written.append(write_picture(scene, _one(scene, name, wish), wish.out))
    if wish.video is not None:
        progress = (lambda _text: None) if quiet else note
        n = write_film(scene, _many(scene, name, wish), wish.video, progress)
        written.append(wish.video)
        progress(say(wish.lang, "overlay.pictures", n=n))
    if not quiet:
        for path in written:
            note(say(wish.lang, "output.wrote", path=str(path)))
    return written


def _estimate_of(store: Store, which: str) -> str:
    """A finding's own estimate; anything else as it is."""
    from twin.reports.finding_shown import finding_shown

    finding = finding_shown(store, which)
    if finding is None:
        return which
    if not finding.estimates:
        raise ConfigError(
            f"The finding {which} is of a sign that was not seen: name the drive and --frame CAMERA:NUMBER."
        )
    return finding.estimates[0]


def _one(scene: DriveScene, name: str | None, wish: Wish) -> Asked:
    from twin.overlay.make import nearest_frame

    if wish.frame == NEAREST:
        return _asked(*nearest_frame(scene, name, wish.camera), wish)
    camera, _, number = (wish.frame or "").rpartition(":")
    if not camera or not number.isdecimal():
        raise ConfigError(
            f"--frame {wish.frame}: write CAMERA:NUMBER, as {sorted(scene.rig.cameras)[0]}:120, or {NEAREST}."
        )
    scene.camera(camera)
    return _asked(camera, int(number), wish)


def _many(scene: DriveScene, name: str | None, wish: Wish) -> Asked:
    from twin.overlay.make import approach

    return _asked(*approach(scene, name, wish.camera), wish)


def _asked(camera: str, frames: object, wish: Wish) -> Asked:
    import numpy as np

    from twin.evidence.masker import NetworkMasker
    from twin.overlay.make import Asked

    masker = None if wish.masker is None else NetworkMasker(wish.masker)
    return Asked(camera, np.atleast_1d(np.asarray(frames, dtype=np.int64)), masker, wish.is_masked, wish.lang)
