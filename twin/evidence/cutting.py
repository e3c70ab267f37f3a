"""One frame → the two crops of a view: masked, drawn over, encoded."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoloc.arrays import FloatArray
from twin import __version__
from twin.evidence.crops import FaceFrom, MaskProof, Role
from twin.evidence.faces import find_faces, outline_of
from twin.evidence.masker import Found, Masker
from twin.evidence.masks import BY_GEOMETRY, BY_NETWORK, RULES, Image, Limits, Regions, filled, masked
from twin.evidence.shots import Look
from twin.evidence.sights import FACE_HALF_WIDTH_M, Marked, Sight

MOST_OF_FRAME = 0.2
"""Largest share of a frame that a crop shows."""
_BOX_GROWN_PX = 1.5
"""A box ends on the face's edge: half a pixel more on each side is its own."""
_MARGIN, _MARGIN_PX = 0.15, 6.0
_CENTRE_HALF_M = 0.5
_NEAR_M, _GROUND_MARGIN_M = 6.0, 0.4
"""NVDB's position is shown up to so far from the foot, and both with so much ground about them."""
_STEPS = 101
_BOX_AWAY_PX = 5.0
_WIDE_QUALITY = 85
_SEEN, _NVDB, _HALO = (230, 159, 0), (86, 180, 233), (0, 0, 0)
"""Orange and sky blue of Okabe and Ito, apart for every kind of colour vision, on a dark edge."""

Rect = tuple[int, int, int, int]
"""Left, top, right, bottom, in whole pixels of the frame; the last two are outside."""


@dataclass(frozen=True, slots=True)
class Cut:
    """One crop, encoded as WebP."""

    role: Role
    content: bytes
    width_px: int
    height_px: int
    proof: MaskProof


@dataclass(frozen=True, slots=True)
class Patch:
    """What is kept of a frame until it is known which one of a view is the sharpest.

    Attributes
    ----------
    image : uint8 (rows, columns, 3)
        The part of the frame that the wide crop shows.
    rect : Rect
        Which part that is.
    face_rect : Rect
    faces_px : tuple of float64 (k, 2)
        In pixels of the frame.
    found : Found or None
        By the network, in pixels of the frame; None where there is none.
    sharpness : float
    """

    look: Look
    image: Image
    rect: Rect
    face_rect: Rect
    faces_px: tuple[FloatArray, ...]
    face_from: FaceFrom
    found: Found | None
    n_frame_px: int
    sharpness: float


def patch_of(image: Image, look: Look, codes: tuple[str, ...], masker: Masker | None) -> Patch:
    """Take from a frame what its crops need."""
    faces, face_from = faces_of(image, look.sight, look.marked, codes)
    size = image.shape[1], image.shape[0]
    shown = np.concatenate(faces) if faces else _place_of_face(look)
    face_rect = _rect(shown, size, max(_MARGIN * float(np.ptp(shown, axis=0).max()), _MARGIN_PX))
    sight = look.sight
    ground = [sight.foot_px]
    if sight.nvdb_px is not None and np.abs(sight.nvdb_px - sight.foot_px).max() < _NEAR_M * sight.px_per_m:
        ground.append(sight.nvdb_px)
    margin = _GROUND_MARGIN_M * sight.px_per_m
    cores = [_union(face_rect, _rect(np.array(ground[:n]), size, margin)) for n in range(len(ground), 0, -1)]
    wide = _union(_rect(np.vstack([sight.wide_px, *ground]), size, 0.0), cores[0])
    rect = _limited(wide, [*cores, face_rect], size)
    left, top, right, low = rect
    patch = image[top:low, left:right].copy()
    return Patch(
        look=look,
        image=patch,
        rect=rect,
        face_rect=face_rect,
        faces_px=faces,
        face_from=face_from,
        found=None if masker is None else masker.find(image, _grown(rect, size)),
        n_frame_px=size[0] * size[1],
        sharpness=_sharpness(image[face_rect[1] : face_rect[3], face_rect[0] : face_rect[2]]),
    )


def cuts_of(patch: Patch, masker: Masker | None, *, is_masked: bool) -> tuple[Cut, Cut]:
    """Mask and encode the two crops of a view; nothing of the picture is written before."""
    return (
        _cut(patch, Role.FACE, patch.face_rect, masker, is_masked=is_masked),
        _cut(patch, Role.WIDE, patch.rect, masker, is_masked=is_masked),
    )


def _cut(patch: Patch, role: Role, rect: Rect, masker: Masker | None, *, is_masked: bool) -> Cut:
    left, top, right, low = rect
    origin = np.array([left, top], dtype=np.float64)
    x, y = left - patch.rect[0], top - patch.rect[1]
    image = patch.image[y : y + low - top, x : x + right - left]
    sight, found = patch.look.sight, patch.found or Found((), ())
    faces = [face - origin for face in patch.faces_px]
    shape = (image.shape[0], image.shape[1])
    boxes = [np.array(box) - np.tile(origin, 2) for box in found.boxes_px]
    limits: Limits = BY_GEOMETRY if patch.found is None else BY_NETWORK
    regions = Regions(
        faces=filled(shape, faces),
        window=filled(shape, [] if patch.faces_px else [sight.window_px - origin]),
        found=filled(shape, [corners(box) for box in boxes]),
    )
    result = masked(image, regions, limits, sight.focal_px, sight.px_per_m)
    shown = result.image if is_masked else image.copy()
    if role is Role.WIDE:
        _draw(shown, sight, patch.faces_px, origin)
    inside = [k for k, box in enumerate(boxes) if _touches(box, shape)]
    proof = MaskProof(
        masker="none" if not is_masked else masker.name if masker is not None else "geometry",
        version=masker.version if masker is not None and is_masked else RULES,
        face_from=patch.face_from,
        faces_px=tuple(tuple((round(u, 1), round(v, 1)) for u, v in face.tolist()) for face in faces),
        boxes_px=tuple((b[0], b[1], b[2], b[3]) for b in (boxes[k].round(1).tolist() for k in inside)),
        labels=tuple(found.labels[k] for k in inside),
        share_hidden=_share(result.hidden) if is_masked else 0.0,
        share_softened=_share(result.softened) if is_masked else 0.0,
        share_clear=_share(~result.hidden & ~result.softened) if is_masked else 1.0,
        hidden_px=round(result.hidden_px, 1),
        softened_px=round(result.softened_px, 1),
        window_px=round(result.window_px, 1),
        place_px=rect,
        of_frame=round(shape[0] * shape[1] / patch.n_frame_px, 4),
        software=f"nvdb-twin {__version__}",
    )
    return Cut(role, _webp(shown, lossless=role is Role.FACE), shape[1], shape[0], proof)


def faces_of(
    image: Image, sight: Sight, marked: Marked, codes: tuple[str, ...]
) -> tuple[tuple[FloatArray, ...], FaceFrom]:
    """Outlines of a sign's faces, in pixels of the frame, and how they are known."""
    if marked.boxes_px:
        boxes = [np.array(box) + _BOX_GROWN_PX * np.array([-1, -1, 1, 1]) for box in marked.boxes_px]
        outline = outline_of(codes[0]) if len(boxes) == len(codes) == 1 else None
        faces = map(corners, boxes) if outline is None else [_inscribed(outline, boxes[0])]
        return tuple(faces), FaceFrom.BOX
    if marked.foot_px is not None or marked.centres_px:
        found = find_faces(image, sight.window_px, codes, sight.metre_px)
        if found:
            return found, FaceFrom.OUTLINE
    return (), FaceFrom.NOWHERE


def _inscribed(outline: FloatArray, box: FloatArray) -> FloatArray:
    """An outline that fills a box: its corners may show somebody."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    return np.asarray(box[:2] + (outline - low) / (high - low) * (box[2:] - box[:2]))


def _place_of_face(look: Look) -> FloatArray:
    """What the face crop shows where the face is not known."""
    if not look.marked.centres_px:
        return look.sight.window_px
    half = _CENTRE_HALF_M / FACE_HALF_WIDTH_M * np.ptp(look.sight.window_px[:, 0]) / 2
    centres = np.array(look.marked.centres_px)
    return np.concatenate([centres - half, centres + half])


def corners(box: FloatArray) -> FloatArray:
    """The four corners (4, 2) of left, top, right, bottom."""
    left, top, right, low = box.tolist()
    return np.array([[left, top], [right, top], [right, low], [left, low]])


def _rect(points: FloatArray, size: tuple[int, int], margin: float) -> Rect:
    low, high = np.floor(points.min(axis=0) - margin), np.ceil(points.max(axis=0) + margin) + 1
    (left, top), (right, bottom) = np.clip(low, 0, size).astype(int), np.clip(high, 0, size).astype(int)
    return int(left), int(top), int(right), int(bottom)


def _union(a: Rect, b: Rect) -> Rect:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def _grown(rect: Rect, size: tuple[int, int]) -> Rect:
    """Half as large again: who is cut by the crop's edge is whole in it."""
    points = np.array([[rect[0], rect[1]], [rect[2] - 1, rect[3] - 1]], dtype=np.float64)
    return _rect(points, size, 0.25 * float(np.ptp(points, axis=0).max()))


def _limited(rect: Rect, cores: Sequence[Rect], size: tuple[int, int]) -> Rect:
    """Cut what is too large a part of the frame, about the first of the cores that is small enough."""
    most = MOST_OF_FRAME * size[0] * size[1]
    core = next((one for one in cores if _area(one) <= most), cores[-1])
    for part in np.linspace(1.0, 0.0, _STEPS):
        grown = np.round(part * np.array(rect) + (1 - part) * np.array(core)).astype(int)
        left, top, right, low = grown.tolist()
        if _area((left, top, right, low)) <= most:
            return left, top, right, low
    return core


def _area(rect: Rect) -> int:
    return (rect[2] - rect[0]) * (rect[3] - rect[1])


def _touches(box: FloatArray, shape: tuple[int, int]) -> bool:
    return bool(box[0] < shape[1] and box[2] > 0 and box[1] < shape[0] and box[3] > 0)


def _share(mask: np.ndarray) -> float:
    return round(float(mask.mean()), 4)


def _sharpness(image: Image) -> float:
    """How strong fine detail is: the variance of the Laplacian over that of the picture."""
    import cv2

    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return float(cv2.Laplacian(grey, cv2.CV_32F).var() / (grey.var() + 1.0)) if grey.size else 0.0


def _draw(image: Image, sight: Sight, faces: tuple[FloatArray, ...], origin: FloatArray) -> None:
    """Draw the face's box, NVDB's position and the ellipse, in thin lines."""
    import cv2

    def line(points: FloatArray, colour: tuple[int, int, int], *, closed: bool = True) -> None:
        whole = [np.round((points - origin) * 16).astype(np.int32)]
        for shade, thickness in ((_HALO, 4), (colour, 2)):
            cv2.polylines(image, whole, closed, shade, thickness, cv2.LINE_AA, 4)

    outline = np.concatenate(faces or (sight.window_px,))
    line(corners(np.array([*outline.min(axis=0) - _BOX_AWAY_PX, *outline.max(axis=0) + _BOX_AWAY_PX])), _SEEN)
    if sight.ellipse_px is not None:
        line(sight.ellipse_px, _SEEN)
    if sight.nvdb_px is not None:
        arm = max(0.25 * sight.px_per_m, 5.0)
        for du, dv in ((arm, 0.0), (0.0, arm)):
            step = np.array([du, dv])
            line(np.array([sight.nvdb_px - step, sight.nvdb_px + step]), _NVDB, closed=False)
        ring = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        line(sight.nvdb_px + 0.6 * arm * np.column_stack([np.cos(ring), np.sin(ring)]), _NVDB)


def _webp(image: Image, *, lossless: bool) -> bytes:
    from PIL import Image as Pillow

    file = io.BytesIO()
    if lossless:
        Pillow.fromarray(image).save(file, "WEBP", lossless=True, quality=80, method=4, exact=True)
    else:
        Pillow.fromarray(image).save(file, "WEBP", quality=_WIDE_QUALITY, method=4)
    return file.getvalue()
