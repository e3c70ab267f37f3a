"""Why an estimate stands where it stands: what the store keeps of one object, put together for people."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np
import sqlalchemy as sa

from geoloc.arrays import FloatArray
from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg
from geoloc.earth.heights import nn2000_from_ellipsoidal
from geoloc.locate.combine import SIGMAS_95, ellipse
from geoloc.rig.rig import Rig, rig_from_document
from twin.errors import ConfigError, StoreError
from twin.ingest.rows import finite
from twin.matching.config import MatchConfig
from twin.matching.sites import Site, sites_from_mirror
from twin.reports.sightings import CameraShare, Frames, cameras_of, frames_of
from twin.store import schema
from twin.store.records import Corrections, Covariance, Estimate
from twin.store.schema import METHODS
from twin.store.store import Snapshot, Store
from twin.words import sentence
from twin.words.reasons import misfit_from_json

Row = Mapping[str, Any]

NEIGHBOURS_M = 15.0
_MAX_NAMED = 8


@dataclass(frozen=True, slots=True)
class BudgetShare:
    """One source of an estimate's error: one sigma along the ellipse's long axis and across it."""

    source: str
    along_m: float
    across_m: float
    share: float
    """Part of the whole variance (both axes together); the shares of all sources add up to 1."""


@dataclass(frozen=True, slots=True)
class EstimateExplained:
    """One estimate with everything that it rests on.

    Attributes
    ----------
    east_m, north_m : float
        EPSG:25833.
    latitude_deg, longitude_deg : float
        EPSG:4326 by NVDB's null transformation.
    height_m, sigma_height_m, height_nn2000_m : float
        `height_m` above the ellipsoid. NaN where unknown.
    covariance_m2 : float64 (2, 2)
        Grid east, grid north.
    major95_m, minor95_m, azimuth_deg : float
        Half axes of the ellipse that holds the object with 95 % probability; the long axis clockwise from
        true north.
    budget : tuple of BudgetShare
        Largest first; empty for methods that do not tell.
    n_sightings, n_frames, n_rejected : int
        Used ones, the frames that they are in, and outliers among the object's sightings.
    corrections : Corrections or None
        What the drive's adjustment found; None for other methods.
    misfits : tuple of str
        In which ways the drive does not fit itself, a clause each.
    absence_gap : str
        Why a sign that the drive passed and did not see may stand all the same; "" if nothing speaks for it.
    neighbours : tuple of Site
        Of the mirror, with a position of their own, within 15 m.
    also : tuple of str
        Estimates of the same object of the same drive by other methods.
    line_m : float64 (k, 2)
        Where the car drove, EPSG:25833.
    """

    estimate_id: str
    object: str
    label: str
    skiltnummer: str
    drive_id: str
    drive_name: str
    method: str
    flags: tuple[str, ...]
    east_m: float
    north_m: float
    latitude_deg: float
    longitude_deg: float
    height_m: float
    sigma_height_m: float
    height_nn2000_m: float
    covariance_m2: FloatArray
    major95_m: float
    minor95_m: float
    azimuth_deg: float
    budget: tuple[BudgetShare, ...]
    n_sightings: int
    n_frames: int
    n_rejected: int
    frames: Frames
    cameras: tuple[CameraShare, ...]
    corrections: Corrections | None
    misfits: tuple[str, ...]
    absence_gap: str
    neighbours: tuple[Site, ...]
    also: tuple[str, ...]
    line_m: FloatArray

    def as_json(self) -> dict[str, Any]:
        """Return everything but the drive's line in types that JSON has; unknown numbers are None."""
        document: dict[str, Any] = _plain(self)
        del document["line_m"]
        against = {name: document.pop(name) for name in ("misfits", "absence_gap")}
        corrections = document["corrections"] or {}
        document["corrections"] = corrections | {name: told for name, told in against.items() if told}
        columns = document["frames"]
        document["frames"] = [
            dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
        ]
        return document


def explain_estimate(store: Store, which: str) -> EstimateExplained:
    """Gather what the store knows of one estimate.

    Parameters
    ----------
    store : Store
    which : str
        An estimate's id (``drive:object:method``), or an object's where only one drive has it: then the
        best method's estimate. ``drive:object`` is understood too.

    Raises
    ------
    ConfigError
        There is no such estimate, or several drives have such an object: the sentence names the candidates.
    StoreError
        The store has no estimates yet.
    """
    with store.snapshot() as view:
        estimate = _chosen(view, which, store.name)
        (drive,) = view.rows(sa.select(schema.drive).where(schema.drive.c.drive_id == estimate.drive_id))
        (of_method,) = view.rows(_of(schema.drive_method, estimate))
        sightings = view.rows(
            _of(schema.sighting, estimate)
            .where(schema.sighting.c.object == estimate.object, schema.sighting.c.is_measured)
            .order_by(schema.sighting.c.epoch_ns, schema.sighting.c.number)
        )
        also = view.rows(_same_object(estimate))
        near = _neighbours(view, estimate.east_m, estimate.north_m)
    frames = frames_of(sightings, _rig(drive))
    return EstimateExplained(
        estimate_id=estimate.estimate_id,
        object=estimate.object,
        label=estimate.label,
        skiltnummer=";".join(estimate.codes),
        drive_id=estimate.drive_id,
        method=estimate.method,
        east_m=estimate.east_m,
        north_m=estimate.north_m,
        height_m=estimate.height_m,
        n_sightings=estimate.n_sightings,
        n_frames=estimate.n_frames,
        n_rejected=estimate.n_rejected,
        drive_name=drive["name"],
        flags=estimate.flags,
        **_place(estimate),
        frames=frames,
        cameras=cameras_of(frames),
        corrections=Corrections.from_json(of_method["corrections"]),
        misfits=tuple(sentence(misfit_from_json(one)) for one in of_method["misfits"]),
        absence_gap=of_method["absence_gap"],
        neighbours=near,
        also=tuple(sorted((r["estimate_id"] for r in also), key=_rank)),
        line_m=_line(drive["line"]),
    )


def _of(table: sa.Table, estimate: Estimate) -> sa.Select[Any]:
    return sa.select(table).where(
        table.c.drive_id == estimate.drive_id, table.c.method == estimate.method.value
    )


def _same_object(estimate: Estimate) -> sa.Select[Any]:
    table = schema.estimate.c
    return sa.select(table.estimate_id).where(
        table.drive_id == estimate.drive_id,
        table.object == estimate.object,
        table.method != estimate.method.value,
    )


def _rank(estimate_id: str) -> int:
    """Best method first."""
    method = estimate_id.rsplit(":", 1)[-1]
    return METHODS.index(method) if method in METHODS else len(METHODS)


def _chosen(view: Snapshot, which: str, store: str) -> Estimate:
    table = schema.estimate.c
    exact = view.rows(sa.select(schema.estimate).where(table.estimate_id == which))
    if exact:
        return Estimate.from_row(exact[0])
    asked = sa.or_(table.object == which, table.drive_id + ":" + table.object == which)
    estimates = [Estimate.from_row(row) for row in view.rows(sa.select(schema.estimate).where(asked))]
    if not estimates:
        raise _no_such(view, which, store)
    best = sorted(estimates, key=lambda e: (_rank(e.estimate_id), e.estimate_id))
    drives = sorted({estimate.drive_id for estimate in estimates})
    if len(drives) > 1:
        names = [next(e.estimate_id for e in best if e.drive_id == drive) for drive in drives]
        raise ConfigError(f"{len(drives)} drives have an object {which!r}: name one of {_listed(names)}.")
    return best[0]


def _no_such(view: Snapshot, which: str, store: str) -> ConfigError | StoreError:
    """Say why there is no such estimate: none at all, an object without a position, or a wrong name."""
    names = [r["object"] for r in view.rows(sa.select(schema.estimate.c.object).distinct())]
    sighting = schema.sighting.c
    reasons = view.rows(
        sa.select(sighting.rejected, sa.func.count().label("n"))
        .where(sa.or_(sighting.object == which, sighting.drive_id + ":" + sighting.object == which))
        .group_by(sighting.rejected, sighting.is_measured)
        .order_by(sa.desc(sighting.is_measured), sa.desc("n"))
    )
    if reasons:
        why = next((r["rejected"] for r in reasons if r["rejected"]), "its rays meet nowhere")
        return ConfigError(f"The object {which!r} in {store} was annotated but has no position: {why}.")
    if not names:
        return StoreError(f"The store {store} has no estimates yet: run `twin ingest-drive` first.")
    findings = [r["change_id"] for r in view.rows(sa.select(schema.change.c.change_id))]
    near = get_close_matches(which, sorted((*names, *findings)), n=3, cutoff=0.5)
    perhaps = f"perhaps {', '.join(near)}" if near else f"it has {_listed(sorted(names))}"
    return ConfigError(f"No estimate, object or finding is called {which!r} in {store}: {perhaps}.")


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:_MAX_NAMED])
    return shown if len(names) <= _MAX_NAMED else f"{shown} and {len(names) - _MAX_NAMED} more"


def _place(estimate: Estimate) -> dict[str, Any]:
    """Position, ellipse and budget in the forms that people read."""
    lat, lon = geographic_from_utm33(estimate.east_m, estimate.north_m)
    ee, en, nn = estimate.covariance_m2
    covariance = np.array([[ee, en], [en, nn]], dtype=np.float64)
    major, minor, grid_azimuth = ellipse(covariance)
    azimuth = float(grid_azimuth + grid_convergence_deg(lat, lon)) % 180.0
    sigma = estimate.sigma_height_m
    return {
        "latitude_deg": float(lat),
        "longitude_deg": float(lon),
        "sigma_height_m": float("nan") if sigma is None else sigma,
        "height_nn2000_m": float(nn2000_from_ellipsoidal(lat, lon, estimate.height_m).height_m),
        "covariance_m2": covariance,
        "major95_m": SIGMAS_95 * float(major),
        "minor95_m": SIGMAS_95 * float(minor),
        "azimuth_deg": azimuth,
        "budget": _budget(estimate.budget, azimuth),
    }


def _budget(budget: Mapping[str, Covariance], azimuth_deg: float) -> tuple[BudgetShare, ...]:
    """Each source's sigmas along the whole's axes; its covariance is in true east and north."""
    sin, cos = np.sin(np.radians(azimuth_deg)), np.cos(np.radians(azimuth_deg))
    whole = sum(ee + nn for ee, _, nn in budget.values())
    shares = []
    for source, (ee, en, nn) in budget.items():
        along = ee * sin**2 + 2.0 * en * sin * cos + nn * cos**2
        # What is left of nothing may be less than nothing by a rounding.
        sigmas = np.sqrt(np.maximum([along, ee + nn - along], 0.0))
        share = (ee + nn) / whole if whole > 0.0 else 0.0
        shares.append(BudgetShare(source, float(sigmas[0]), float(sigmas[1]), share))
    return tuple(sorted(shares, key=lambda s: (-s.share, s.source)))


def _rig(drive: Row) -> Rig:
    return rig_from_document(json.loads(zlib.decompress(drive["rig"])), source=drive["name"])


def _neighbours(view: Snapshot, east_m: float, north_m: float) -> tuple[Site, ...]:
    here = np.array([east_m, north_m])
    sites = sites_between(view, here - NEIGHBOURS_M, here + NEIGHBOURS_M)
    distance = {s: np.hypot(s.east_m - east_m, s.north_m - north_m) for s in sites if s.own_geometry}
    return tuple(sorted((s for s in distance if distance[s] <= NEIGHBOURS_M), key=distance.__getitem__))


def sites_between(view: Snapshot, low_m: FloatArray, high_m: FloatArray) -> list[Site]:
    """Return the mirror's signs between two corners, south-west and north-east (EPSG:25833)."""

    def near(table: sa.Table) -> sa.ColumnElement[bool]:
        return sa.and_(
            table.c.east_m.between(float(low_m[0]), float(high_m[0])),
            table.c.north_m.between(float(low_m[1]), float(high_m[1])),
        )

    def rows(table: sa.Table, wanted: sa.ColumnElement[bool]) -> list[Row]:
        columns = [column for column in table.columns if column.name != "raw"]
        return view.rows(sa.select(*columns).where(wanted))

    points = rows(schema.skiltpunkt, near(schema.skiltpunkt))
    plate = schema.skiltplate
    of_these = plate.c.point_id.in_([point["nvdb_id"] for point in points])
    return sites_from_mirror(points, rows(plate, sa.or_(near(plate), of_these)), MatchConfig())


def _line(wkb: bytes) -> FloatArray:
    import shapely

    return np.asarray(shapely.get_coordinates(shapely.from_wkb(wkb)), dtype=np.float64)


def _plain(value: Any) -> Any:
    """Dataclasses → dicts, arrays → lists, NaN → None."""
    if hasattr(value, "__dataclass_fields__"):
        return {name: _plain(getattr(value, name)) for name in value.__dataclass_fields__}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return finite(value) if isinstance(value, float) else value
