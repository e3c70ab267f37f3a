"""Why a sighting was not located, or has no pose: a kind that code decides by, and the sentence for it."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, TextArray


class Reason(StrEnum):
    """Why a sighting, or an object, has no position. Where it has one, arrays of reasons hold ""."""

    NO_POSE = "no-pose"
    BEFORE_FIRST_FIX = "before-first-fix"
    AFTER_LAST_FIX = "after-last-fix"
    IN_GAP = "in-gap"
    FIX_FAR_OFF = "fix-far-off"
    STANDING = "standing"
    STANDING_PAIR = "standing-pair"
    COURSE_IN_NOISE = "course-in-noise"
    OUTSIDE_CAMERA = "outside-camera"
    WIDER_THAN_MODEL = "wider-than-model"
    ON_CAR = "on-car"
    NO_RAY = "no-ray"
    ABOVE_HORIZON = "above-horizon"
    TOO_FAR = "too-far"
    TOO_FAR_ON_TERRAIN = "too-far-on-terrain"
    CAMERA_UNDERGROUND = "camera-underground"
    TERRAIN_UNKNOWN = "terrain-unknown"
    TERRAIN_UNKNOWN_AT_CAR = "terrain-unknown-at-car"
    OTHER_GROUND = "other-ground"
    FACE_ALONE = "face-alone"
    NO_OBJECT = "no-object"
    SLIP = "slip"
    NO_CROSSING = "no-crossing"
    NO_POSITION = "no-position"
    TOO_VAGUE = "too-vague"
    OUTLIER = "outlier"
    INTERPOLATED = "interpolated"


REASON_TYPE = f"U{max(map(len, Reason))}"
"""Type of an array that any reason fits into."""

_FAR_AWAY = (Reason.ABOVE_HORIZON, Reason.TOO_FAR, Reason.TOO_FAR_ON_TERRAIN)
_OF_EPOCH = (Reason.BEFORE_FIRST_FIX, Reason.AFTER_LAST_FIX, Reason.IN_GAP)
_SENTENCES = {
    Reason.NO_POSE: "no pose",
    Reason.FIX_FAR_OFF: "the nearest fix is too far away in time",
    Reason.STANDING: "standing still with one antenna: no heading",
    Reason.STANDING_PAIR: "standing still without a usable pair of antennas: no heading",
    Reason.COURSE_IN_NOISE: "no heading: the course is lost in the noise of the fixes",
    Reason.OUTSIDE_CAMERA: "outside the camera's image or model",
    Reason.WIDER_THAN_MODEL: "the camera's field of view leaves its model's domain",
    Reason.ON_CAR: "on the car itself",
    Reason.NO_RAY: "no ray",
    Reason.ABOVE_HORIZON: "above the horizon",
    Reason.TOO_FAR: "more than {max_range_m:g} m away on flat ground",
    Reason.TOO_FAR_ON_TERRAIN: "more than {max_range_m:g} m away on the terrain",
    Reason.CAMERA_UNDERGROUND: "the camera is not above the ground",
    Reason.TERRAIN_UNKNOWN: "the terrain's height is not known there",
    Reason.TERRAIN_UNKNOWN_AT_CAR: "the terrain's height is not known under the car",
    Reason.OTHER_GROUND: (
        "the terrain is not at the car's height: a bridge, a tunnel, or another height system"
    ),
    Reason.FACE_ALONE: "a box: one frame cannot say how far away a face is",
    Reason.NO_OBJECT: "belongs to no object",
    Reason.SLIP: "no object stands there, and one near it lacks this picture: a slip of the hand",
    Reason.NO_CROSSING: "its rays meet nowhere within 150 m, or it was seen from one place only",
    Reason.NO_POSITION: "no usable sighting, or its rays meet nowhere",
    Reason.TOO_VAGUE: "seen under too small an angle: one sigma is more than 5 m",
    Reason.OUTLIER: "does not fit the other sightings of its object",
    Reason.INTERPOLATED: "interpolated between key frames: seen, but not measured",
}


def sentence_of(
    reason: Reason,
    *,
    max_range_m: float,
    span_ns: tuple[int, int],
    seconds: float | None = None,
) -> str:
    """Make the clause that people read.

    Parameters
    ----------
    max_range_m : float
        How far a single frame was asked to look.
    span_ns : (int, int)
        First and last epoch of the trajectory.
    seconds : float, optional
        How far the epoch lies outside the trajectory, or how long the gap is that it lies in
        (`Trajectory.missing_s`). Without it the clause speaks of all such epochs.
    """
    if reason not in _OF_EPOCH:
        return _SENTENCES[reason].format(max_range_m=max_range_m)
    first, last = (np.datetime64(ns, "ns").astype("datetime64[ms]") for ns in span_ns)
    bounds = f"(the trajectory covers {first} to {last} UTC)"
    by = "" if seconds is None else f"{seconds:.3f} s "
    if reason == Reason.BEFORE_FIRST_FIX:
        return f"{by}before the first fix {bounds}"
    if reason == Reason.AFTER_LAST_FIX:
        return f"{by}after the last fix {bounds}"
    return f"inside a gap {'' if seconds is None else f'of {seconds:.1f} s '}between two fixes"


def sentences_of(
    reason: TextArray, *, max_range_m: float, span_ns: tuple[int, int], seconds: FloatArray
) -> list[str]:
    """Make the clauses of many sightings (n,), "" where there is no reason: see `sentence_of`."""
    plain = {
        one: sentence_of(Reason(one), max_range_m=max_range_m, span_ns=span_ns) if one else ""
        for one in np.unique(reason).tolist()
    }
    texts = [plain[one] for one in reason.tolist()]
    for i in np.flatnonzero(np.isin(reason, _OF_EPOCH)).tolist():
        texts[i] = sentence_of(
            Reason(str(reason[i])), max_range_m=max_range_m, span_ns=span_ns, seconds=float(seconds[i])
        )
    return texts


def stands_far_away(reason: TextArray) -> BoolArray:
    """Whether each sighting's object stands beyond the reach of the ground: on the horizon, or too far."""
    return np.isin(reason, _FAR_AWAY)
