"""Rows of the store as records: what a drive measured of an object, and what a match says of a sign.

Rows and joined strings stay at the store's edge (`from_row`, `to_row`); inside, codes, drives, cameras and
flags are tuples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from typing import Any

from twin.store.kinds import Method, Verdict
from twin.words import Why, reason_of, why_from_json, why_to_json
from twin.words.reasons import Reopened, Told

Row = Mapping[str, Any]
Covariance = tuple[float, float, float]
"""East-east, east-north and north-north [m²]."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Where one annotated object stands, as one drive gives it by one method: a row of ``estimate``.

    Attributes
    ----------
    codes : tuple of str
        Sign code of each plate, top down; empty if not annotated.
    east_m, north_m : float
        EPSG:25833.
    height_m : float
        Of its foot, ellipsoidal; NaN of ``paper``, which gives none.
    sigma_height_m : float or None
        None where the method does not tell.
    covariance_m2 : (float, float, float)
        Grid east and grid north.
    first_ns, last_ns : int
        Epochs of the first and last sighting, UTC.
    budget : mapping of source → covariance, true east and north
        Empty where the method does not tell.
    nvdb_type : int or None
        Of an object that is no sign.
    text : str or None
        On its plates, joined by ";" as NVDB's codes are; None where none was annotated.
    joined : tuple of str
        ``drive:object`` of the objects of one drive that were put together into this one; empty in the store.
    """

    drive_id: str
    object: str
    codes: tuple[str, ...]
    east_m: float
    north_m: float
    covariance_m2: Covariance
    cameras: tuple[str, ...]
    n_sightings: int
    first_ns: int = 0
    last_ns: int = 0
    text: str | None = None
    budget: Mapping[str, Covariance] = field(default_factory=dict)
    estimate_id: str = ""
    method: Method = Method.ADJUSTED
    label: str = ""
    height_m: float = math.nan
    sigma_height_m: float | None = None
    n_frames: int = 0
    n_cameras: int = 0
    range_min_m: float = math.nan
    n_rejected: int = 0
    flags: tuple[str, ...] = ()
    nvdb_type: int | None = None
    joined: tuple[str, ...] = ()

    @property
    def members(self) -> tuple[str, ...]:
        """``drive:object`` of everything that it is made of."""
        return self.joined or (f"{self.drive_id}:{self.object}",)

    @property
    def member(self) -> str:
        """``drive:object`` of itself."""
        return f"{self.drive_id}:{self.object}"

    @classmethod
    def from_row(cls, row: Row) -> Estimate:
        """Take it from a row of the table ``estimate``."""
        # The row of ``paper`` has the height of the car's fix.
        height_m = math.nan if row["method"] == Method.PAPER else row["height_m"]
        return cls(
            **{name: row[name] for name in _SAME_IN_ESTIMATE} | {"height_m": height_m},
            method=Method(row["method"]),
            codes=split_codes(row["skiltnummer"]),
            covariance_m2=(row["cov_ee_m2"], row["cov_en_m2"], row["cov_nn_m2"]),
            cameras=tuple(row["cameras"]),
            flags=tuple(flag for flag in row["flags"].split(";") if flag),
            # In one order whatever the database keeps: what is added up is the same to the last bit.
            budget={source: (ee, en, nn) for source, (ee, en, nn) in sorted(row["budget"].items())},
        )

    def to_row(self) -> dict[str, Any]:
        """Return its row of the table ``estimate``."""
        return {
            **{name: getattr(self, name) for name in _SAME_IN_ESTIMATE},
            "method": self.method.value,
            "skiltnummer": ";".join(self.codes),
            **_covariance_columns(self.covariance_m2),
            "cameras": list(self.cameras),
            "flags": ";".join(self.flags),
            "budget": {source: list(covariance) for source, covariance in self.budget.items()},
        }


_SAME_IN_ESTIMATE = (
    *("estimate_id", "drive_id", "object", "label", "east_m", "north_m", "height_m", "sigma_height_m"),
    *("n_sightings", "n_frames", "n_cameras", "first_ns", "last_ns", "range_min_m", "n_rejected"),
    *("nvdb_type", "text"),
)


@dataclass(frozen=True, slots=True)
class Finding:
    """What a match says of one sign: a row of ``change``.

    Attributes
    ----------
    change_id : str
        The same finding has the same one in every run (:func:`twin.matching.verdicts.finding.change_id`).
    why : Why
        Its reason, as a kind with facts: :func:`twin.words.reason_of` makes the sentence.
    confidence : float
        Probability that the verdict is right; of ``review`` that of the likeliest reading.
    skiltnummer_nvdb, skiltnummer_seen : tuple of str
        Codes of the plates, top down.
    drive_ids : tuple of str
        The drives that saw it, or looked for it, in time order.
    east_m, north_m : float
        EPSG:25833, where the sign stands now: the measured position, or NVDB's for what was not seen.
    covariance_m2 : (float, float, float) or None
        Of the measured position, grid east and grid north; None where nothing was measured.
    terms : mapping
        What verdict and confidence rest on, as JSON (``docs/matching.md``).
    cameras : tuple of str
        That saw it, or looked for it.
    reopened : Reopened or Told, optional
        What was decided of it and has changed since; not of the match, but of the log of decisions.
    """

    change_id: str
    verdict: Verdict
    why: Why
    confidence: float
    nvdb_type: int
    nvdb_id: int | None
    nvdb_version: int | None
    skiltnummer_nvdb: tuple[str, ...]
    skiltnummer_seen: tuple[str, ...]
    distance_m: float | None
    distance_sigma_m: float | None
    drive_ids: tuple[str, ...]
    n_sightings: int
    east_m: float
    north_m: float
    terms: Mapping[str, Any] = field(default_factory=dict)
    covariance_m2: Covariance | None = None
    cameras: tuple[str, ...] = ()
    reopened: Reopened | Told | None = None

    @property
    def reason(self) -> str:
        """The reason in English, without the names of signs."""
        return reason_of(self)

    @classmethod
    def from_row(cls, row: Row) -> Finding:
        """Take it from a row of the table ``change``."""
        terms = dict(row["terms"] or {})
        why = terms.pop(_WHY, None)
        covariance = (row["cov_ee_m2"], row["cov_en_m2"], row["cov_nn_m2"])
        return cls(
            **{name: row[name] for name in _SAME_IN_FINDING},
            verdict=Verdict(row["verdict"]),
            skiltnummer_nvdb=_parts(row["skiltnummer_nvdb"], ";"),
            skiltnummer_seen=_parts(row["skiltnummer_seen"], ";"),
            drive_ids=_parts(row["drive_ids"], ","),
            cameras=_parts(row["cameras"], ","),
            # Findings of before reasons were kept as kinds have their sentence alone.
            why=Told(row["reason"]) if why is None else why_from_json(why),
            terms=terms,
            covariance_m2=None if None in covariance else covariance,
        )

    def to_row(self) -> dict[str, Any]:
        """Return its row of the table ``change``."""
        return {
            **{name: getattr(self, name) for name in _SAME_IN_FINDING},
            "verdict": self.verdict.value,
            "reason": self.reason,
            "skiltnummer_nvdb": ";".join(self.skiltnummer_nvdb),
            "skiltnummer_seen": ";".join(self.skiltnummer_seen),
            "drive_ids": ",".join(self.drive_ids),
            "cameras": ",".join(self.cameras),
            "terms": {**self.terms, _WHY: why_to_json(self.why)},
            **_covariance_columns(self.covariance_m2),
        }


_WHY = "why"
"""Where the row's terms keep the reason."""

_SAME_IN_FINDING = (
    *("change_id", "confidence", "nvdb_type", "nvdb_id", "nvdb_version"),
    *("distance_m", "distance_sigma_m", "n_sightings", "east_m", "north_m"),
)


@dataclass(frozen=True, slots=True)
class Correction:
    """What an adjustment found out about one quantity, with one sigma; None where it is not known."""

    value: float
    sigma: float | None


@dataclass(frozen=True, slots=True)
class Boresight:
    """By how much a camera is turned against the rig file, degrees about its own axes."""

    pitch: Correction
    yaw: Correction
    roll: Correction


@dataclass(frozen=True, slots=True)
class Corrections:
    """What the adjustment of a drive found out about the car: ``corrections`` of ``drive_method``.

    Attributes
    ----------
    pixel_noise_factor : float
        Noise of a pixel against the stated one.
    camera_offset_ms : Correction
        Added to the camera clock.
    rolling_shutter_ms : Correction
        First to last row.
    boresight_deg : mapping of camera → Boresight
    camera_prior_ms : float or None
        One sigma of the camera clock that was taken for granted; None of drives ingested before it was kept.
    receiver_late_ms : float
        One sigma of how late the positions may be, which is part of it.
    camera_solved_ms : float or None
        One sigma of the camera clock by the least squares alone; None of drives ingested before it was kept.
    track_lasts_s : float
        Correlation time of what the track's places are off.
    """

    pixel_noise_factor: float
    camera_offset_ms: Correction
    rolling_shutter_ms: Correction
    boresight_deg: Mapping[str, Boresight]
    camera_prior_ms: float | None = None
    receiver_late_ms: float = 0.0
    camera_solved_ms: float | None = None
    track_lasts_s: float = 120.0

    @classmethod
    def from_json(cls, document: Mapping[str, Any]) -> Corrections | None:
        """Take it from the store's JSON; None of an empty object, which other methods leave."""
        if not document:
            return None
        return cls(
            pixel_noise_factor=document["pixel_noise_factor"],
            camera_offset_ms=Correction(**document["camera_offset_ms"]),
            rolling_shutter_ms=Correction(**document["rolling_shutter_ms"]),
            boresight_deg={
                camera: Boresight(**{axis: Correction(**one) for axis, one in axes.items()})
                for camera, axes in document["boresight_deg"].items()
            },
            camera_prior_ms=document.get("camera_prior_ms"),
            receiver_late_ms=document.get("receiver_late_ms", 0.0),
            camera_solved_ms=document.get("camera_solved_ms"),
            track_lasts_s=document.get("track_lasts_s", 120.0),
        )

    def to_json(self) -> dict[str, Any]:
        """Return it as the store keeps it."""
        return asdict(self)


@lru_cache(maxsize=10_000)  # a fleet's plates carry few different ones
def split_codes(text: str) -> tuple[str, ...]:
    """``"362.50;808.1"`` → ``("362.50", "808.1")``."""
    return tuple(code.strip() for code in text.split(";") if code.strip())


def _parts(text: str | None, separator: str) -> tuple[str, ...]:
    return tuple(text.split(separator)) if text else ()


def _covariance_columns(covariance_m2: Covariance | None) -> dict[str, float | None]:
    ee, en, nn = covariance_m2 or (None, None, None)
    return {"cov_ee_m2": ee, "cov_en_m2": en, "cov_nn_m2": nn}
