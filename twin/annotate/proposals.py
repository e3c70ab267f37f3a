"""Proposals of a page of marks: places of its signs, and where they must be in a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.locate.records import Kind
from twin.annotate.geometry import Click, Geometry, Offer, Place, Seen, correction_px
from twin.annotate.marks import Mark, Page, Where
from twin.annotate.records import ProposalItem
from twin.drives.drive import Annotations

_MOST_FOREIGN = 12
"""Of the clicks of other tools so many are enough to place a sign for proposals."""
_LOOSE_PX, _TIGHT_PX = 30.0, 10.0
"""How far proposals may well be off: by one click or in a camera that has none of the sign, and otherwise."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A sign with its place.

    Attributes
    ----------
    clicks : tuple of Click
    place : Place
    misses : dict of Click to float64 (2,)
    seen : dict of camera to Seen
    offers : list of Offer
    """

    clicks: tuple[Click, ...]
    place: Place
    misses: dict[Click, FloatArray]
    seen: dict[str, Seen]
    offers: list[Offer]


class Proposals:
    """Places of signs, worked out anew only for signs that were clicked.

    Parameters
    ----------
    geometry : Geometry
    cameras : sequence of str
    foreign : Annotations
        Of other tools: their measured marks help to place the signs that were marked here too.
    """

    def __init__(self, geometry: Geometry, cameras: Sequence[str], foreign: Annotations) -> None:
        self._geometry = geometry
        self._cameras = cameras
        self._foreign = foreign
        self._kept: dict[str, tuple[tuple[Click, ...], Placed | None]] = {}

    def of(self, page: Page) -> dict[str, Placed]:
        """Place all signs of a page; those without a place are absent."""
        clicks: dict[str, list[Click]] = {}
        for where, mark in page.marks.items():
            if mark.is_measured:
                click = Click(where.object, where.camera, where.frame, where.kind, mark.pixel_px)
                clicks.setdefault(where.object, []).append(click)
        placed = {}
        for name, own in clicks.items():
            found = self._placed(name, (*own, *self._foreign_clicks(name)))
            if found is not None:
                placed[name] = found
        return placed

    def in_picture(self, page: Page, camera: str, frame: int) -> list[ProposalItem]:
        """Where signs must be in a picture in which they are not yet marked."""
        placed, items = self.of(page), list[ProposalItem]()
        for name, one in placed.items():
            kind = Kind.BOX if one.place.is_face else Kind.FOOT
            seen = one.seen.get(camera)
            rows = np.zeros(0, np.int64) if seen is None else np.flatnonzero(seen.frame == frame)
            if seen is None or not rows.size:
                continue
            own = {click: miss for click, miss in one.misses.items() if click.camera == camera}
            shift = correction_px(own, _usual_miss(placed, name, camera), frame)
            pixel, range_m = seen.pixel_px[rows[0]] + shift, float(seen.range_m[rows[0]])
            radius = _TIGHT_PX if own and len(one.clicks) > 1 else _LOOSE_PX
            if kind is Kind.FOOT and Where(name, camera, frame, kind) not in page.marks:
                items.append(ProposalItem(name, kind, pixel.tolist(), radius, range_m))
            if Where(name, camera, frame, Kind.BOX) not in page.marks:
                box = self._face(page, name, one, camera, pixel, range_m)
                items += [] if box is None else [ProposalItem(name, Kind.BOX, box, radius, range_m)]
        return items

    def _face(
        self, page: Page, name: str, one: Placed, camera: str, pixel: FloatArray, range_m: float
    ) -> list[float] | None:
        """The sign's box as it was last drawn in this camera, as large as the distance has it."""
        drawn = [
            (where.frame, mark)
            for where, mark in page.marks.items()
            if (where.object, where.camera, where.kind) == (name, camera, Kind.BOX) and mark.is_measured
        ]
        seen = one.seen[camera]
        for frame, mark in reversed(drawn):
            rows = np.flatnonzero(seen.frame == frame)
            if rows.size:
                factor = float(seen.range_m[rows[0]]) / range_m
                then = np.array([seen.pixel_px[rows[0]], seen.pixel_px[rows[0]]]).ravel()
                if one.place.is_face:
                    then = np.tile(mark.pixel_px, 2)
                foot = page.marks.get(Where(name, camera, frame, Kind.FOOT))
                then = then if foot is None or one.place.is_face else np.tile(foot.pixel_px, 2)
                return list((np.tile(pixel, 2) + (np.array(mark.place_px) - then) * factor).tolist())
        return None

    def _placed(self, name: str, clicks: tuple[Click, ...]) -> Placed | None:
        kept = self._kept.get(name)
        if kept is not None and kept[0] == clicks:
            return kept[1]
        place, found = self._geometry.place(clicks), None
        if place is not None:
            found = Placed(
                clicks,
                place,
                self._geometry.misses(place, clicks),
                {camera: self._geometry.seen(place, camera) for camera in self._cameras},
                self._geometry.offers(place, clicks),
            )
        self._kept[name] = clicks, found
        return found

    def _foreign_clicks(self, name: str) -> list[Click]:
        rows = np.flatnonzero((self._foreign.object == name) & self._foreign.is_measured)
        step = max(1, -(-rows.size // _MOST_FOREIGN))
        of = self._foreign
        return [
            Click(
                name,
                str(of.camera[k]),
                int(of.frame[k]),
                Kind(str(of.kind[k])),
                (float(of.pixel_px[k, 0]), float(of.pixel_px[k, 1])),
            )
            for k in rows[::step].tolist()
        ]


def confirmed(items: Sequence[ProposalItem], camera: str, frame: int) -> dict[Where, Mark]:
    """Return proposals as marks that say that the sign was seen, and measure nothing."""
    return {
        Where(item.object, camera, frame, item.kind): Mark(tuple(item.place_px), is_measured=False)
        for item in items
    }


def _usual_miss(placed: dict[str, Placed], name: str, camera: str) -> FloatArray:
    """Mean miss of the other signs' clicks in a camera; of single clicks there is none."""
    misses = [
        miss
        for other, one in placed.items()
        if other != name and len(one.clicks) > 1
        for click, miss in one.misses.items()
        if click.camera == camera
    ]
    return np.mean(misses, axis=0) if misses else np.full(2, np.nan)
