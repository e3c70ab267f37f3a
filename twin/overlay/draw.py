"""Lines and words over one picture, and the strip of facts below it."""

from __future__ import annotations

import datetime as dt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray
from twin.overlay.lines import FrameLines, ShownThing
from twin.words import Lang, say

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont
    from PIL.ImageFont import ImageFont as BitmapFont

    Font = FreeTypeFont | BitmapFont

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

CLICK, ESTIMATE, NVDB = (240, 228, 66), (230, 159, 0), (86, 180, 233)
"""Yellow, orange and sky blue of Okabe and Ito."""
REJECTED, GUIDE = (213, 94, 0), (225, 225, 225)
_HALO: Colour = (0, 0, 0)
_STRIP, _STRIP_TEXT = (24, 26, 30), (235, 235, 235)
_ARM_PX = 9.0


class Facts(NamedTuple):
    """What the strip below a picture says."""

    drive: str
    method: str
    camera: str
    frame: int
    epoch_ns: int
    is_masked: bool


def drawn(image: Image, lines: FrameLines | None, facts: Facts, lang: Lang) -> Image:
    """Draw over a copy of a picture.

    Parameters
    ----------
    image : uint8 (rows, columns, 3)
        RGB, masked already if it is to be.
    lines : FrameLines or None
        None: the track has no pose here, and the strip says so.

    Returns
    -------
    uint8 (rows + strip, columns, 3)
        Both sides even, as films need them.
    """
    shown = image.copy()
    size = max(image.shape[1] / 1920.0, 0.35)
    if lines is not None:
        _draw_guides(shown, lines, size)
        for sign in lines.signs:
            _draw_sign(shown, sign, size)
        for estimate in lines.estimates:
            _draw_estimate(shown, estimate, size)
        for click in lines.clicks:
            colour = CLICK if click.is_used else REJECTED
            if click.box_px is not None:
                left, top, right, low = click.box_px
                box = np.array([[left, top], [right, top], [right, low], [left, low], [left, top]])
                _polyline(shown, box, colour, size)
            _cross(shown, np.array(click.pixel_px), colour, size, turned=True)
        shown = _named(shown, lines, size)
    return _with_strip(shown, lines, facts, lang, size)


def _draw_guides(image: Image, lines: FrameLines, size: float) -> None:
    _polyline(image, lines.horizon_px, GUIDE, size, thickness=1)
    for _, ring in lines.rings_px:
        _polyline(image, ring, GUIDE, size, thickness=1)


def _draw_sign(image: Image, shown: ShownThing, size: float) -> None:
    ring = np.linspace(0, 2 * np.pi, 33)
    _polyline(
        image,
        shown.pixel_px + _ARM_PX * size * np.column_stack([np.cos(ring), np.sin(ring)]),
        NVDB,
        size,
    )
    _cross(image, shown.pixel_px, NVDB, size)


def _draw_estimate(image: Image, shown: ShownThing, size: float) -> None:
    if shown.ellipse_px is not None:
        _polyline(image, np.vstack([shown.ellipse_px, shown.ellipse_px[:1]]), ESTIMATE, size)
    _cross(image, shown.pixel_px, ESTIMATE, size)


def _cross(image: Image, at: FloatArray, colour: Colour, size: float, *, turned: bool = False) -> None:
    arm = _ARM_PX * size
    steps = ((arm, arm), (arm, -arm)) if turned else ((arm, 0.0), (0.0, arm))
    for du, dv in steps:
        step = np.array([du, dv])
        _polyline(image, np.array([at - step, at + step]), colour, size)


def _polyline(image: Image, points: FloatArray, colour: Colour, size: float, *, thickness: int = 2) -> None:
    """Draw a line on a dark edge, in pieces where it leaves the picture."""
    import cv2

    known = np.isfinite(points).all(axis=1)
    ends = np.flatnonzero(np.diff(known.astype(np.int8), prepend=0, append=0))
    pieces = [
        np.round(points[start:stop] * 16).astype(np.int32)
        for start, stop in zip(ends[::2], ends[1::2], strict=True)
        if stop - start > 1
    ]
    width = max(round(thickness * size), 1)
    for shade, wide in ((_HALO, width + 2), (colour, width)):
        cv2.polylines(image, pieces, False, shade, wide, cv2.LINE_AA, 4)


def _named(image: Image, lines: FrameLines, size: float) -> Image:
    """Write names, distances and the horizon's beside what they belong to."""
    from PIL import Image as Pillow
    from PIL import ImageDraw

    picture = Pillow.fromarray(image)
    draw = ImageDraw.Draw(picture)
    small, normal = _font(17 * size), _font(20 * size)

    def write(at: FloatArray, text: str, colour: Colour, font: Font, dv: float) -> None:
        place = (float(at[0] + 1.5 * _ARM_PX * size), float(at[1] + dv * size))
        draw.text(place, text, fill=colour, font=font, stroke_width=2, stroke_fill=_HALO)

    for shown in lines.signs:
        write(shown.pixel_px, shown.what.name, NVDB, normal, 6)
    for shown in lines.estimates:
        text = f"{shown.what.name}  {shown.range_m:.1f} m"
        write(shown.pixel_px, text, ESTIMATE, normal, -26)
    for radius, ring in lines.rings_px:
        if (middle := _middle(ring)) is not None:
            write(middle, f"{radius:g} m", GUIDE, small, -20)
    return np.asarray(picture)


def _middle(line: FloatArray) -> FloatArray | None:
    """The middle of what is seen of a line."""
    seen = line[np.isfinite(line).all(axis=1)]
    return seen[len(seen) // 2] if len(seen) else None


def _with_strip(image: Image, lines: FrameLines | None, facts: Facts, lang: Lang, size: float) -> Image:
    from PIL import Image as Pillow
    from PIL import ImageDraw

    rows, columns = image.shape[:2]
    high = round(64 * size)
    whole = np.empty((rows + high + (rows + high) % 2, columns + columns % 2, 3), np.uint8)
    whole[:] = _STRIP
    whole[:rows, :columns] = image
    picture = Pillow.fromarray(whole)
    draw, font = ImageDraw.Draw(picture), _font(19 * size)
    when = dt.datetime.fromtimestamp(facts.epoch_ns / 1e9, tz=dt.UTC)
    speed = "" if lines is None else f"  {3.6 * float(lines.pose.speed_mps[0]):.0f} km/h"
    where = (
        f"{facts.drive}  {facts.camera}  {say(lang, 'overlay.frame', n=facts.frame)}"
        f"  {when:%Y-%m-%d %H:%M:%S}.{when.microsecond // 1000:03d} UTC{speed}"
    )
    if lines is None:
        where += f"  {say(lang, 'overlay.no_pose')}"
    if not facts.is_masked:
        where += f"  {say(lang, 'overlay.unmasked')}"
    left = 12 * size
    draw.text((left, rows + 7 * size), where, fill=_STRIP_TEXT, font=font)
    for colour, text in (
        (CLICK, say(lang, "overlay.click")),
        (ESTIMATE, say(lang, "overlay.estimate", method=facts.method)),
        (NVDB, "NVDB"),
        (GUIDE, say(lang, "overlay.guides")),
    ):
        draw.text((left, rows + 36 * size), text, fill=colour, font=font)
        left += draw.textlength(text, font=font) + 28 * size
    return np.asarray(picture)


def _font(size: float) -> Font:
    from PIL import ImageFont

    return ImageFont.load_default(max(size, 9.0))
