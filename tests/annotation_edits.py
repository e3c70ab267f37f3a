"""Changes to the tracks that a drive folder's CVAT files hold."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from drive_damage import both, frames_later, hosts_later

DAY_S = 86_400


def edit_tracks(trip: Path, change: Callable[[str], str], files: str = "*.xml") -> None:
    """Put every track, with its tags, through `change`."""
    for path in trip.glob(files):
        text = path.read_text(encoding="utf-8")
        edited = re.sub(r"<track .*?</track>", lambda track: change(track[0]), text, flags=re.DOTALL)
        path.write_text(edited, encoding="utf-8")


def without_tracks(trip: Path, holding: str = "") -> None:
    """Take out the tracks that hold a text; the files stay."""
    edit_tracks(trip, lambda track: "" if holding in track else track)


def as_boxes(trip: Path, files: str = "*.xml", holding: str = "") -> None:
    """Draw the tracks that hold a text as boxes of 10 px around their points."""

    def box(point: re.Match[str]) -> str:
        x, y = float(point[2]), float(point[3])
        return f'<box{point[1]} xtl="{x - 5}" ytl="{y - 5}" xbr="{x + 5}" ybr="{y + 5}"'

    def boxed(track: str) -> str:
        if holding not in track:
            return track
        return re.sub(r'<points(.*?) points="(.*?),(.*?)"', box, track).replace("</points>", "</box>")

    edit_tracks(trip, boxed, files)


def days_later(trip: Path, days: int) -> None:
    """Move a drive's fixes and frames: another recording of the same road."""
    both(hosts_later(days * DAY_S), frames_later(days * DAY_S))(trip)
