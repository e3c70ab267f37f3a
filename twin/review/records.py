"""What the page and the server say to each other: every body of the API, as records that become JSON.

Positions are WGS84 (EPSG:4326), longitude first. Texts are for people and are never decided by; ids,
verdicts, states and kinds are.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Literal

import msgspec

from twin.store.kinds import Decision
from twin.web.base_map import BaseMap

Coordinates = list[float] | list[list[float]] | list[list[list[float]]]


class State(StrEnum):
    """What is decided of a finding, as one reviewer may see it."""

    OPEN = Decision.OPEN
    ACCEPT = Decision.ACCEPT
    DISMISS = Decision.DISMISS
    DEFER = Decision.DEFER
    DISAGREEMENT = "disagreement"
    """It is open, and people who did not see each other's answers said different things."""


class Order(StrEnum):
    """In which order findings come."""

    CONFIDENCE = "confidence"
    VERDICT = "verdict"
    ROAD = "road"
    PLACE = "place"


class Queue(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which findings are meant, and in which order; "" for every."""

    verdict: str = ""
    state: str = ""
    road: str = ""
    drive: str = ""
    kommune: str = ""
    order: Order = Order.VERDICT


class StateCounts(msgspec.Struct):
    """How many findings of a verdict are in which state."""

    open: int = 0
    accept: int = 0
    dismiss: int = 0
    defer: int = 0


class AgreementCount(msgspec.Struct, frozen=True):
    """Of how many findings two people or more gave an opinion, and of how many they all say the same."""

    n: int
    n_agreed: int


class DriveItem(msgspec.Struct, frozen=True):
    """A drive; its date is that of its start, UTC."""

    drive_id: str
    name: str
    date: str


class SessionRecord(msgspec.Struct, frozen=True, kw_only=True):
    """What the page needs once.

    ``notice``: why nothing can be answered now, a sentence, or null. ``disagreements``: findings on which
    people who answered blindly differ. ``agreement``: by verdict. ``bounds``: west, south, east, north, or
    null where nothing was found.
    """

    store: str
    reviewer: str
    lang: str
    read_only: bool
    blind: bool
    notice: str | None
    reviewers: list[str]
    counts: dict[str, StateCounts]
    disagreements: int
    agreement: dict[str, AgreementCount]
    kommuner: list[int]
    drives: list[DriveItem]
    roads: list[str]
    base_map: BaseMap | None
    bounds: tuple[float, float, float, float] | None
    messages: dict[str, str]


class FindingItem(msgspec.Struct, frozen=True):
    """A finding in a list."""

    change_id: str
    verdict: str
    state: State
    confidence: float
    title: str
    road: str
    lon: float
    lat: float


class FindingList(msgspec.Struct, frozen=True):
    """A piece of a list, and how long all of it is."""

    total: int
    items: list[FindingItem]


class Points(msgspec.Struct, frozen=True):
    """Findings for a map, a column each."""

    change_id: list[str]
    lon: list[float]
    lat: list[float]
    verdict: list[str]
    state: list[State]


class Sign(msgspec.Struct, frozen=True):
    """A sign code and its name; the name is the code where the catalogue gives none."""

    code: str
    name: str


class Claim(msgspec.Struct, frozen=True, kw_only=True):
    """What NVDB says of the object."""

    nvdb_id: int
    nvdb_type: int
    version: int | None
    codes: list[Sign]
    text: str
    lon: float | None
    lat: float | None
    accuracy_cm: float | None
    last_modified: str | None
    url_vegkart: str


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    """What the drives saw. ``height_m``: NN2000, null where not known."""

    codes: list[Sign]
    text: str
    lon: float
    lat: float
    height_m: float | None
    sigma_sentence: str


class CropItem(msgspec.Struct, frozen=True, kw_only=True):
    """A picture of the finding: ``face``, the sign alone, or ``wide``, with what was claimed drawn in."""

    number: int
    role: str
    url: str
    width: int
    height: int
    range_m: float
    camera: str
    when: str
    drive: str
    caption: str
    proof: str


class Term(msgspec.Struct, frozen=True):
    """One thing that the confidence rests on."""

    label: str
    value: str
    explanation: str


class HistoryItem(msgspec.Struct, frozen=True):
    """One entry of the log of decisions, as far as this reviewer may see it."""

    at: str
    by: str
    decision: str
    comment: str
    sentence: str


class Geometry(msgspec.Struct, frozen=True):
    """A GeoJSON geometry."""

    type: Literal["Point", "LineString", "Polygon"]
    coordinates: Coordinates


class Properties(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Of a feature of a finding's map.

    ``kind`` is one of seen, nvdb, ellipse (95 %), ray, camera, track and neighbour. ``facing_deg``: where a
    camera looks, clockwise from true north. ``change_id``: of a neighbour that is a finding itself.
    """

    kind: str
    title: str = ""
    drive: str = ""
    camera: str = ""
    facing_deg: float | None = None
    change_id: str = ""


class Feature(msgspec.Struct, frozen=True):
    """A GeoJSON feature."""

    geometry: Geometry
    properties: Properties
    type: Literal["Feature"] = "Feature"


class FeatureCollection(msgspec.Struct, frozen=True):
    """GeoJSON."""

    features: list[Feature]
    type: Literal["FeatureCollection"] = "FeatureCollection"


class FindingRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Everything about one finding.

    ``revision`` goes back with the answer (``seen_revision``): what the person saw. ``notice`` says why it
    cannot be answered, or is null.
    """

    change_id: str
    revision: str
    verdict: str
    verdict_title: str
    state: State
    confidence: float
    can_answer: bool
    notice: str | None
    seen_sentence: str
    reason: str
    road: str
    claim: Claim | None
    seen: Seen | None
    distance_m: float | None
    crops: list[CropItem]
    gaps: list[str]
    terms: list[Term]
    history: list[HistoryItem]
    map: FeatureCollection


class AnswerRequest(msgspec.Struct, frozen=True, kw_only=True):
    """An answer; with ``queue`` the next finding is that of this list.

    ``temporary``: dismissed as a sign of road works, which speaks for others of the same works.
    """

    change_id: str
    answer: str
    seen_revision: str
    comment: str = ""
    temporary: bool = False
    queue: Queue = Queue()


class AnswerRecord(msgspec.Struct, frozen=True):
    """What became of an answer: ``entry_id`` is its place in the log."""

    change_id: str
    state: State
    entry_id: int
    next: str | None


class UndoRequest(msgspec.Struct, frozen=True):
    """Takes back this reviewer's last answer of this session."""


class UndoRecord(msgspec.Struct, frozen=True):
    """The finding that is open again, or as it was before."""

    change_id: str


class ReviewerRequest(msgspec.Struct, frozen=True):
    """Who sits at this browser, or who gave the answers that it kept while no server was there."""

    name: str
    of_kept_answers: bool = False


class ReviewerRecord(msgspec.Struct, frozen=True):
    """The name as it is kept."""

    reviewer: str


class AnswerItem(msgspec.Struct, frozen=True):
    """One answer of this session that was not taken back."""

    change_id: str
    decision: str
    comment: str
    at: str
    title: str


class AnswerList(msgspec.Struct, frozen=True):
    """The answers of this session, newest first."""

    items: list[AnswerItem]
