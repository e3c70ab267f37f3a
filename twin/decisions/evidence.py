"""What a decision rests on, and whether that has really changed since."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import sqlalchemy as sa

from twin.store import schema
from twin.store.records import split_codes
from twin.words.reasons import (
    CodesKnownChanged,
    CodesSeenChanged,
    Difference,
    MeasuredMoved,
    NvdbMoved,
    VerdictChanged,
    VersionChanged,
)

Row = Mapping[str, Any]
Ask = Callable[[sa.Select[Any]], list[Row]]
"""Runs a query: :meth:`twin.store.store.Store.rows`, or that of a snapshot or of
:func:`twin.decisions.log.asking`."""

_CHI2_95_2DOF = 5.991
"""95 % quantile of chi-square with two degrees of freedom: the 95 % ellipse."""
_NVDB_MOVED_M = 0.01
"""Less than NVDB states for any position: rounding, not a move."""
_DECIMALS = 3


@dataclass(frozen=True, slots=True)
class Evidence:
    """What was known of a finding at one moment.

    Attributes
    ----------
    verdict, nvdb_type, nvdb_id, nvdb_version, skiltnummer_nvdb, skiltnummer_seen, distance_m
        As in the ``change`` table.
    east_m, north_m : float
        EPSG:25833, to the millimetre: the measured position, or NVDB's for what was not seen.
    covariance_m2 : (float, float, float) or None
        Of the measured position: east-east, east-north, north-north. None where nothing was measured, or
        where it is not known.
    nvdb_east_m, nvdb_north_m : float or None
        NVDB's position of the object; None where it has none, or where it is not known.
    pole : str
        Key of the pole that it is about, the same in every match whatever annotators call it; "" where
        nothing was seen, or where it is not known.
    confidence : float or None
        That the match had; None of decisions from before it was kept, and of files without it.
    n_drives : int
        That the finding rested on; 0 where it is not known.
    """

    verdict: str
    nvdb_type: int
    nvdb_id: int | None
    nvdb_version: int | None
    skiltnummer_nvdb: str
    skiltnummer_seen: str
    distance_m: float | None
    east_m: float
    north_m: float
    covariance_m2: tuple[float, float, float] | None
    nvdb_east_m: float | None
    nvdb_north_m: float | None
    pole: str = ""
    confidence: float | None = None
    n_drives: int = 0

    def as_json(self) -> dict[str, Any]:
        """Return it as the log keeps it."""
        return asdict(self)

    @classmethod
    def from_json(cls, document: Row) -> Evidence:
        """Take it back from the log."""
        covariance = document["covariance_m2"]
        return cls(**{**document, "covariance_m2": None if covariance is None else tuple(covariance)})

    @classmethod
    def from_row(cls, row: Row) -> Evidence:
        """Take it from a row of the ``change`` table, or of an exported layer with the same names.

        Without a covariance the distance's standard deviation serves for both directions, if there is one.
        """
        return cls(
            verdict=row["verdict"],
            nvdb_type=row["nvdb_type"],
            nvdb_id=row["nvdb_id"],
            nvdb_version=row["nvdb_version"],
            skiltnummer_nvdb=row["skiltnummer_nvdb"],
            skiltnummer_seen=row["skiltnummer_seen"],
            distance_m=_rounded(row["distance_m"]),
            east_m=round(float(row["east_m"]), _DECIMALS),
            north_m=round(float(row["north_m"]), _DECIMALS),
            covariance_m2=_covariance(row),
            nvdb_east_m=_rounded(row.get("nvdb_east_m")),
            nvdb_north_m=_rounded(row.get("nvdb_north_m")),
            pole=(row.get("terms") or {}).get("pole", ""),
            confidence=None if row.get("confidence") is None else round(float(row["confidence"]), 4),
            n_drives=len([drive for drive in (row.get("drive_ids") or "").split(",") if drive]),
        )


def present_evidence(ask: Ask, only: Collection[str] | None = None) -> dict[str, Evidence]:
    """What is known now of the findings of the last match, or of those named, in the order of their ids."""
    asked = _changes_with_nvdb()
    rows = ask(asked if only is None else asked.where(schema.change.c.change_id.in_(only)))
    return {row["change_id"]: Evidence.from_row(row) for row in rows}


def _changes_with_nvdb() -> sa.Select[Any]:
    """Select the findings of the last match with NVDB's position of their object beside them."""
    change, point, plate = schema.change, schema.skiltpunkt, schema.skiltplate
    joined = change
    for number, table in ((95, point), (96, plate)):
        joined = joined.outerjoin(
            table, (change.c.nvdb_type == number) & (table.c.nvdb_id == change.c.nvdb_id)
        )  # type: ignore[assignment]
    return (
        sa.select(
            change,
            sa.func.coalesce(point.c.east_m, plate.c.east_m).label("nvdb_east_m"),
            sa.func.coalesce(point.c.north_m, plate.c.north_m).label("nvdb_north_m"),
        )
        .select_from(joined)
        .order_by(change.c.change_id)
    )


def differences(then: Evidence, now: Evidence) -> tuple[Difference, ...]:
    """Say what has really changed between two states of a finding; nothing if it is the same.

    A measured position that stays inside its own 95 % ellipse of then, another confidence, more sightings or
    one more drive are no change.
    """
    found: list[Difference] = []
    if then.verdict != now.verdict:
        found.append(VerdictChanged(then.verdict, now.verdict))
    if _codes(then.skiltnummer_seen) != _codes(now.skiltnummer_seen):
        found.append(CodesSeenChanged(split_codes(then.skiltnummer_seen), split_codes(now.skiltnummer_seen)))
    if _codes(then.skiltnummer_nvdb) != _codes(now.skiltnummer_nvdb):
        found.append(CodesKnownChanged(split_codes(then.skiltnummer_nvdb), split_codes(now.skiltnummer_nvdb)))
    if then.nvdb_version != now.nvdb_version:
        found.append(VersionChanged(then.nvdb_version, now.nvdb_version))
    moved = _nvdb_moved_m(then, now)
    if moved is not None and moved > _NVDB_MOVED_M:
        found.append(NvdbMoved(round(moved, _DECIMALS)))
    if _left_ellipse(then, now):
        distance = math.hypot(now.east_m - then.east_m, now.north_m - then.north_m)
        found.append(MeasuredMoved(round(distance, _DECIMALS)))
    return tuple(found)


def same_place(then: Evidence, now: Evidence) -> bool:
    """Whether what is seen now may stand where it stood then: inside the 95 % ellipse of then."""
    return then.covariance_m2 is not None and not _left_ellipse(then, now)


def _left_ellipse(then: Evidence, now: Evidence) -> bool:
    if then.covariance_m2 is None or now.covariance_m2 is None:
        return False
    ee, en, nn = then.covariance_m2
    east, north = now.east_m - then.east_m, now.north_m - then.north_m
    # The squared Mahalanobis distance, both sides times the determinant.
    return nn * east * east - 2 * en * east * north + ee * north * north > _CHI2_95_2DOF * (ee * nn - en * en)


def _nvdb_moved_m(then: Evidence, now: Evidence) -> float | None:
    positions = (then.nvdb_east_m, then.nvdb_north_m, now.nvdb_east_m, now.nvdb_north_m)
    stated = [value for value in positions if value is not None]
    if len(stated) < len(positions):
        return None
    east, north, east_now, north_now = stated
    return math.hypot(east_now - east, north_now - north)


def _codes(text: str) -> list[str]:
    return sorted(split_codes(text))


def _covariance(row: Row) -> tuple[float, float, float] | None:
    columns = [row.get(name) for name in ("cov_ee_m2", "cov_en_m2", "cov_nn_m2")]
    if not any(value is None for value in columns):
        ee, en, nn = (float(value) for value in columns if value is not None)
        return ee, en, nn
    sigma = row.get("distance_sigma_m")
    return None if sigma is None else (float(sigma) ** 2, 0.0, float(sigma) ** 2)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(float(value), _DECIMALS)
