"""What goes over the wire between the annotation page and its server, as JSON."""

from __future__ import annotations

import msgspec

from geoloc.locate.records import Kind


class OfferItem(msgspec.Struct, frozen=True):
    """A picture that is worth a click."""

    camera: str
    frame: int
    range_m: float


class SignItem(msgspec.Struct, frozen=True):
    """One sign.

    Attributes
    ----------
    title : str
        ``142 – Barn``.
    n_clicks : int
        Measured marks.
    n_seen : int
        Proposals that were confirmed.
    sigma_m : float or None
        Of its place; None of a single click, or without a place.
    worst_px : float or None
        The largest miss of its clicks against its place.
    in_view : dict of camera to list of int
        Pictures that have its place in view.
    marked : dict of camera to list of int
        Pictures in which it is marked.
    offers : list of OfferItem
        Pictures to click next, the best first.
    is_foreign : bool
        Whether another tool's file holds it: its marks stay as they are.
    """

    object: str
    codes: str
    title: str
    by: str
    n_clicks: int
    n_seen: int
    sigma_m: float | None
    worst_px: float | None
    in_view: dict[str, list[int]]
    marked: dict[str, list[int]]
    offers: list[OfferItem]
    is_foreign: bool


class State(msgspec.Struct, frozen=True):
    """All signs, after each change.

    Attributes
    ----------
    object : str
        The sign that the change was of; "" of none.
    can_undo : bool
    copies : list of str
        Copies that were made of files before they were replaced.
    """

    object: str
    signs: list[SignItem]
    can_undo: bool
    copies: list[str]


class CameraItem(msgspec.Struct, frozen=True):
    """One camera: the size of its pictures, and the numbers of its frames that have one.

    Attributes
    ----------
    moments_s : list of float
        When each was taken, from the drive's first picture; -1 where nobody knows.
    file : str
        In which its marks are kept.
    """

    name: str
    width_px: int
    height_px: int
    frames: list[int]
    moments_s: list[float]
    file: str


class SessionRecord(msgspec.Struct, frozen=True):
    """What the page needs once."""

    drive: str
    by: str
    lang: str
    is_complete: bool
    notices: list[str]
    cameras: list[CameraItem]
    state: State
    messages: dict[str, str]


class MarkItem(msgspec.Struct, frozen=True):
    """A mark in a picture.

    Attributes
    ----------
    place_px : list of float
        Foot (x, y), or box (left, top, right, bottom).
    is_measured : bool
    file : str
        The other tool's file that it stands in; "" of the page's own.
    """

    object: str
    kind: Kind
    place_px: list[float]
    is_measured: bool
    file: str = ""


class ProposalItem(msgspec.Struct, frozen=True):
    """Where a sign must be in a picture; `radius_px` is how far off that may well be."""

    object: str
    kind: Kind
    place_px: list[float]
    radius_px: float
    range_m: float


class PictureRecord(msgspec.Struct, frozen=True):
    """What is known of one picture."""

    camera: str
    frame: int
    marks: list[MarkItem]
    proposals: list[ProposalItem]


class CodeItem(msgspec.Struct, frozen=True):
    """A sign code that was searched for."""

    code: str
    title: str


class CodeList(msgspec.Struct, frozen=True):
    """The codes that fit best."""

    items: list[CodeItem]


class MarkRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Somebody clicked a foot or drew a box; `object` is "" for a sign that is new."""

    object: str
    camera: str
    frame: int
    kind: Kind
    place_px: list[float]
    codes: str = ""


class ConfirmRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Somebody looked, and the sign is where it is proposed."""

    object: str
    camera: str
    frame: int


class RemoveRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Marks to take away: of one picture, or all of a sign where `camera` is ""."""

    object: str
    camera: str = ""
    frame: int = 0


class NameRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What stands on a pole, top down, joined by ``;``; `is_meant` where a code that no list has is meant."""

    object: str
    codes: str
    is_meant: bool = False


class UndoRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Take the last change back."""
