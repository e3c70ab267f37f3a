"""One pole over many passes: a linear least squares over all poles and all drives.

What a drive says of a pole is its true place plus four kinds of errors::

    place = pole + track(t) + speed · (clock found - clock) + own

- The track is off by what moves everything that the drive sees: satellites, atmosphere, a datum. It lasts for
  minutes: a first-order Gauss–Markov process along the drive, east and north.
- The clock, of the receiver or of the camera, moves places along the way the car drove. Each drive found its
  own as well as it could. Receivers of one car are late by about as much in every drive, so that all drives
  together know it better; drives both ways show it too.
- Own errors of one pass: pixels, bounce, heading.
- What is the same in every pass is not averaged: the ground below the pole, and the car (lever arms, the
  cameras' places and boresight, their shutters).

With one drive alone each position and covariance comes back as it was.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray
from geoloc.locate.accuracy import nees

_STAMPED_S = 0.005
# Shares of variances that all drives of a car have in common: of how frames are stamped, and of how late the
# receiver's filter is. A clock that is known to the second only is each drive's own.
_STAMPED_ALIKE, _LATE_ALIKE = 0.5, 0.9
# Beyond rounding: where nothing tells the time, a clock is known as well as it was stated to.
_DOUBTED = 1.01
# (1 mm)²: keeps weights finite where an estimate states nothing of its own.
_FLOOR_M2 = 1e-6
# Where less than this share of a pass is checked by anything else, rounding is all that is left.
_TOLD = 1e-6
# Poles that are placed at a time, and how many of those about them go into it: what lies further off says
# next to nothing, and everything at once would cost the cube of their number.
_AT_ONCE, _WITHIN = 150, 300


@dataclass(frozen=True, slots=True)
class Passes:
    """Estimates of poles, one row for each drive past each pole.

    Axes are east and north of one plane, the same for all rows.

    Attributes
    ----------
    pole, drive : int64 (n,)
        Numbers from 0.
    epoch_ns : int64 (n,)
        When the drive passed.
    place_m : float64 (n, 2)
    own_m2, common_m2 : float64 (n, 2, 2)
        Covariance of what is this pass's own, and of what is the same in every pass.
    track_m : float64 (n,)
        One sigma a horizontal axis of the track.
    ahead_mps : float64 (n, 2)
        How far a second that the clock found is too large moves it: along the way the car drove.
    lasts_s : float64 (n,)
        Correlation time of the track's error, the same in all rows of a drive.
    """

    pole: IntArray
    drive: IntArray
    epoch_ns: IntArray
    place_m: FloatArray
    own_m2: FloatArray
    common_m2: FloatArray
    track_m: FloatArray
    ahead_mps: FloatArray
    lasts_s: FloatArray


@dataclass(frozen=True, slots=True)
class Clocks:
    """Clocks of drives, one row each: what is to be added to the camera's, so that it fits the track.

    Attributes
    ----------
    car : int64 (d,)
        Numbers from 0; drives of one car have receivers that are late by about as much.
    found_s, sigma_s : float64 (d,)
        What the adjustment of that drive alone says.
    prior_s : float64 (d,)
        One sigma, about 0, that it took for granted.
    late_s : float64 (d,)
        One sigma of how late the receiver may be, which is part of it.
    """

    car: IntArray
    found_s: FloatArray
    sigma_s: FloatArray
    prior_s: FloatArray
    late_s: FloatArray

    @classmethod
    def of_drives(
        cls,
        car: IntArray,
        found_s: FloatArray,
        sigma_s: FloatArray,
        prior_s: FloatArray,
        late_s: FloatArray,
    ) -> Clocks:
        """Clocks as drives state them; `prior_s` is 0 where a drive does not say.

        A clock that was doubted is known worse than it was stated to. What was found is then the drive's
        own, as where nobody says what it was stated to: it stays where it is.
        """
        doubted = sigma_s > _DOUBTED * prior_s
        return cls(
            car,
            found_s,
            sigma_s,
            np.where(doubted, 2.0 * sigma_s, np.maximum(prior_s, sigma_s)),
            late_s,
        )

    def by_rays(self) -> tuple[FloatArray, FloatArray]:
        """What sightings alone say of the clocks: their value, and the information in it (one over s²)."""
        information = np.maximum(self.sigma_s**-2.0 - self.prior_s**-2.0, 0.0)
        there = information > 0.0
        value = self.found_s / self.sigma_s**2 / np.where(there, information, 1.0)
        return np.where(there, value, 0.0), information

    def alike_s(self) -> tuple[FloatArray, FloatArray]:
        """One sigma of what all drives of a car have in common, and of what each has of its own."""
        late = np.minimum(self.late_s, self.prior_s) ** 2
        stamped = np.minimum(self.prior_s**2 - late, _STAMPED_S**2)
        alike = _STAMPED_ALIKE * stamped + _LATE_ALIKE * late
        return np.sqrt(alike), np.sqrt(self.prior_s**2 - alike)


@dataclass(frozen=True, slots=True)
class Known:
    """Places of poles that somebody measured, one row a pole's number.

    Attributes
    ----------
    place_m : float64 (m, 2)
        NaN for a pole that nobody measured.
    sigma_m : float64 (m,)
        One sigma an axis.
    """

    place_m: FloatArray
    sigma_m: FloatArray

    @property
    def there(self) -> BoolArray:
        """Which poles have one."""
        return np.isfinite(self.place_m[:, 0])

    def part(self, poles: IntArray) -> Known:
        """Those of some poles."""
        return Known(self.place_m[poles], self.sigma_m[poles])


@dataclass(frozen=True, slots=True)
class Fused:
    """Places of poles, one row each, in the order of their numbers.

    Attributes
    ----------
    place_m : float64 (m, 2)
        NaN for a number that no pass has.
    covariance_m2 : float64 (m, 2, 2)
    square : float64 (n,)
        Of each pass: by how much its place is off what all else says of it, its own drive at other poles too,
        squared over the variance of that (chi-square with two degrees of freedom). 0 where nothing else does.
    """

    place_m: FloatArray
    covariance_m2: FloatArray
    square: FloatArray


def fuse(passes: Passes, clocks: Clocks, known: Known | None = None) -> Fused:
    """Fuse all passes of all drives.

    Poles whose places are known tie the drives' tracks down. Such a pole itself is placed without its own
    known place: what is compared with that later has not been drawn to it.

    Parameters
    ----------
    passes : Passes (n,)
    clocks : Clocks (d,)
    known : Known (m,), optional

    Returns
    -------
    Fused
    """
    poles = max(int(passes.pole.max(initial=-1)) + 1, 0 if known is None else len(known.place_m))
    square = np.zeros(passes.pole.size)
    fused = Fused(np.full((poles, 2), np.nan), np.full((poles, 2, 2), np.nan), square)
    there, first = np.unique(passes.pole, return_index=True)
    about = passes.place_m[first]
    for some in _neighbourhoods(about):
        middle = about[some].mean(axis=0)
        order = np.argsort(np.linalg.norm(about - middle, axis=1), kind="stable")
        window = np.union1d(some, order[:_WITHIN])
        rows = np.flatnonzero(np.isin(passes.pole, there[window]))
        part = Passes(*(getattr(passes, name)[rows] for name in Passes.__dataclass_fields__))
        number = np.searchsorted(there[window], part.pole)
        of_window = None if known is None else known.part(there[window])
        place, covariance, off = _solved(replace(part, pole=number), clocks, of_window, middle)
        wanted = np.searchsorted(window, some)
        mine = np.isin(number, wanted)
        square[rows[mine]] = off[mine]
        fused.place_m[there[some]], fused.covariance_m2[there[some]] = place[wanted], covariance[wanted]
    return fused


def _neighbourhoods(place_m: FloatArray) -> Iterator[IntArray]:
    """Halve places (m, 2), across where they reach furthest, until few enough are left to solve at a time."""
    left = [np.arange(len(place_m))] if len(place_m) else []
    while left:
        some = left.pop()
        if some.size <= (_AT_ONCE if len(place_m) > _WITHIN else _WITHIN):
            yield some
            continue
        axis = int(np.argmax(np.ptp(place_m[some], axis=0)))
        order = some[np.argsort(place_m[some, axis], kind="stable")]
        left += [np.sort(order[: order.size // 2]), np.sort(order[order.size // 2 :])]


def _solved(
    passes: Passes, clocks: Clocks, known: Known | None, origin_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places and covariances of all poles ``(m, 2)``, ``(m, 2, 2)``, no gaps, and squares of passes (n,).

    Unknown are the poles, then the clocks of the drives and of the cars. A drive's track needs no unknowns:
    it makes the errors of the drive's passes dependent.
    """
    poles, drives = int(passes.pole.max()) + 1, np.unique(passes.drive)
    mine = replace(clocks, **{name: getattr(clocks, name)[drives] for name in Clocks.__dataclass_fields__})
    normal, right = _of_clocks(mine, 2 * poles)
    of_drives = []
    for number, drive in enumerate(drives):
        rows = np.flatnonzero(passes.drive == drive)
        weight = np.linalg.inv(_covariance(passes, rows))
        ahead = passes.ahead_mps[rows].ravel()
        seen = (passes.place_m[rows] - origin_m).ravel() - mine.found_s[number] * ahead
        columns = (2 * passes.pole[rows, None] + np.arange(2)).ravel()
        clock = 2 * poles + number
        by_clock = weight @ -ahead
        normal[np.ix_(columns, columns)] += weight
        normal[columns, clock] += by_clock
        normal[clock, columns] += by_clock
        normal[clock, clock] += -ahead @ by_clock
        right[columns] += weight @ seen
        right[clock] += by_clock @ seen
        of_drives.append((rows, np.append(columns, clock), weight, by_clock, seen))
    at = 2 * np.arange(poles)
    tied = np.zeros(poles, dtype=bool) if known is None else known.there
    if known is not None:
        information = known.sigma_m[tied] ** -2.0
        for axis in range(2):
            columns = at[tied] + axis
            normal[columns, columns] += information
            right[columns] += information * (known.place_m[tied, axis] - origin_m[axis])
    inverse = np.linalg.inv(normal)
    found = inverse @ right
    square = np.zeros(passes.pole.size)
    for rows, columns, weight, by_clock, seen in of_drives:
        derived = np.column_stack([weight, by_clock])
        off = weight @ seen - derived @ found[columns]
        known_by_all = np.asarray(derived @ inverse[np.ix_(columns, columns)] @ derived.T)
        square[rows] = _squares(off, np.asarray(weight), known_by_all)
    place = found[: 2 * poles].reshape(-1, 2)
    blocks = np.array([[inverse[at + i, at + j] for j in (0, 1)] for i in (0, 1)]).transpose(2, 0, 1)
    if known is not None and tied.any():
        whole = np.linalg.inv(blocks[tied])
        others = np.linalg.inv(whole - information[:, None, None] * np.eye(2))
        pull = (whole @ place[tied, :, None])[:, :, 0]
        pull -= information[:, None] * (known.place_m[tied] - origin_m)
        blocks[tied], place[tied] = others, (others @ pull[:, :, None])[:, :, 0]
    covariance = 0.5 * (blocks + blocks.swapaxes(1, 2)) + _not_averaged(passes, clocks, poles)
    return place + origin_m, covariance, square


def _squares(off: FloatArray, weight: FloatArray, known: FloatArray) -> FloatArray:
    """What each pass (k,) contradicts all else by, squared over its variance.

    Baarda's test, for the two numbers of a pass: `off` are weighted residuals (2k,), and ``weight - known``
    their covariance.

    Notes
    -----
    Baarda (1968), "A testing procedure for use in geodetic networks", Publications on Geodesy 2 (5).
    """
    one = np.arange(off.size // 2)
    left = (weight - known).reshape(one.size, 2, one.size, 2)[one, :, one, :]
    own = weight.reshape(one.size, 2, one.size, 2)[one, :, one, :]
    told = np.linalg.eigvalsh(left)[:, 0] > _TOLD * np.trace(own, axis1=1, axis2=2)
    square, pair = np.zeros(one.size), off.reshape(-1, 2)
    square[told] = nees(pair[told], left[told])
    return square


def _of_clocks(clocks: Clocks, first: int) -> tuple[FloatArray, FloatArray]:
    """Normal matrix and right side of what is known of clocks without the poles.

    That is what sightings say of each drive's clock, and how far it may be from that of its car. Clocks of
    drives begin at `first`, those of cars follow.
    """
    drives = clocks.car.size
    cars, car = np.unique(clocks.car, return_inverse=True)
    size = first + drives + cars.size
    normal, right = np.zeros((size, size)), np.zeros(size)
    value, information = clocks.by_rays()
    alike, own = clocks.alike_s()
    for number in range(drives):
        clock, of_car = first + number, first + drives + int(car[number])
        normal[clock, clock] += information[number] + own[number] ** -2.0
        normal[clock, of_car] = normal[of_car, clock] = -alike[number] / own[number] ** 2
        normal[of_car, of_car] += (alike[number] / own[number]) ** 2
        right[clock] += information[number] * value[number]
    cars_at = first + drives + np.arange(cars.size)
    normal[cars_at, cars_at] += 1.0
    return normal, right


def _covariance(passes: Passes, rows: IntArray) -> FloatArray:
    """Covariance ``(2k, 2k)`` of what a drive says of poles, but for the clock: east and north in turn."""
    k = rows.size
    track, epoch_s = passes.track_m[rows], passes.epoch_ns[rows] / 1e9
    since_s = np.abs(epoch_s[:, None] - epoch_s)
    moved = np.outer(track, track) * np.exp(-since_s / passes.lasts_s[rows])
    whole = np.kron(moved, np.eye(2)).reshape(k, 2, k, 2)
    one = np.arange(k)
    whole[one, :, one, :] += passes.own_m2[rows] + passes.common_m2[rows] + _FLOOR_M2 * np.eye(2)
    return np.asarray(whole.reshape(2 * k, 2 * k))


def _not_averaged(passes: Passes, clocks: Clocks, poles: int) -> FloatArray:
    """What the equations averaged of errors that are the same in every pass ``(m, 2, 2)``.

    They weigh such errors as if each pass had its own: of n passes alike 1/n is left, and here is the rest.
    """
    total = passes.own_m2 + passes.common_m2
    late = (clocks.sigma_s[passes.drive, None] * passes.ahead_mps) ** 2
    spread = np.trace(total, axis1=1, axis2=2) + 2.0 * passes.track_m**2 + late.sum(axis=1)
    weight = 1.0 / (spread + _FLOOR_M2)
    weight = weight / np.bincount(passes.pole, weight, poles)[passes.pole]
    mean = np.zeros((poles, 2, 2))
    np.add.at(mean, passes.pole, weight[:, None, None] * passes.common_m2)
    left = np.bincount(passes.pole, weight**2, poles)
    return np.asarray((1.0 - left)[:, None, None] * mean)
