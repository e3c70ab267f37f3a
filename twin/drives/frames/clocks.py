"""How well the stamps of pictures are known against the UTC of the track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import IntArray
from geoloc.trajectory.trajectory import GnssFixes
from twin.drives.epochs import HOST_DELAY_LIMIT_S
from twin.drives.folder.drive_toml import SETTINGS_FILE
from twin.drives.frames.stamp_files import NO_STAMP

_NS = 1_000_000_000
STATED_MS = 1000.0
"""One sigma of a start that a person states, or a camera that no receiver sets: read off a clock that is
seconds off itself, or to the second."""
WHOLE_SECONDS_MS = 500.0
"""One sigma of times in whole seconds, of which the fraction was cut off."""
_FEWEST, _ROUNDED_NS = 10, 1_000
_DELAYS_S = (-0.05, HOST_DELAY_LIMIT_S)
"""A link is not faster than light, and slower than this no receiver sends its fixes."""


@dataclass(frozen=True, slots=True)
class StatedClock:
    """Why stamps are less well known than those of a triggered camera.

    Attributes
    ----------
    sigma_ms : float
        One sigma of what all of them are off.
    why : str
        A clause, for people: ``the start of front was stated in drive.toml``.
    """

    sigma_ms: float
    why: str

    def sentence(self) -> str:
        """What the clock is taken as, and why; without a full stop."""
        return f"The camera clock is taken as good to {self.sigma_ms / 1e3:.1f} s, as {self.why}"


def computed(epoch_ns: IntArray, where: str) -> StatedClock | None:
    """Tell stamps that were counted on from a whole second at an even rate: nobody measured them."""
    stamped = np.flatnonzero(epoch_ns != NO_STAMP)
    if stamped.size < _FEWEST:
        return None
    since_ns = epoch_ns[stamped] - epoch_ns[stamped[0]]
    number = stamped - stamped[0]
    even_ns = np.round(number * (since_ns[-1] / number[-1]))
    off_second_ns = (epoch_ns[stamped[0]] + _NS // 2) % _NS - _NS // 2
    if max(np.abs(since_ns - even_ns).max(), abs(off_second_ns)) > _ROUNDED_NS:
        return None
    return StatedClock(STATED_MS, f"the stamps of {where} were counted on from a whole second, not measured")


def of_host(gnss: Sequence[GnssFixes]) -> StatedClock | None:
    """Tell a host clock that is not on the UTC of the fixes: the cameras are stamped by the same clock."""
    delays_s = [float(np.median(fixes.host_ns - fixes.epoch_ns)) / _NS for fixes in gnss]
    wrong_s = [delay_s for delay_s in delays_s if not _DELAYS_S[0] <= delay_s <= _DELAYS_S[1]]
    if not wrong_s:
        return None
    worst_s = max(wrong_s, key=abs)
    return StatedClock(1e3 * abs(worst_s), f"the host stamped its fixes {worst_s:+.2f} s after their UTC")


def worst(clocks: Sequence[StatedClock | None]) -> StatedClock | None:
    """The one that is known least."""
    return max((clock for clock in clocks if clock), key=lambda clock: clock.sigma_ms, default=None)


def stated_start(camera: str) -> StatedClock:
    """Return the clock of a video whose start ``drive.toml`` states."""
    return StatedClock(STATED_MS, f"the start of {camera} is stated in {SETTINGS_FILE}")
