"""What one drive gives the store, as records: the drive itself, its sightings, what a method found out of it.

They are made without a store and are the same in every process: plain values and arrays, to be pickled.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from geoloc.arrays import BoolArray, FloatArray, IntArray, TextArray
from geoloc.trajectory.trajectory import Poses
from twin.store.kinds import Method
from twin.store.poses import blob_from_poses
from twin.store.records import Corrections
from twin.words import why_to_json
from twin.words.reasons import Misfit


@dataclass(frozen=True, slots=True, eq=False)
class DriveRecord:
    """A recorded drive: a row of ``drive``.

    Attributes
    ----------
    started_ns, ended_ns : int
        First and last epoch, UTC.
    datum : str
        Of its positions before they were brought to EUREF89.
    length_m : float
        Driven.
    delay_ms : float or None
        How late host stamps are after GNSS (median); None where there are none.
    line : bytes
        WKB LineString of the path, EPSG:25833.
    rig_document : str
        The rig file that it was located with.
    poses : Poses
        Where the car was, EUREF89: one every 0.3 m, or a second where it was slower.
    content_sha256 : str
        Of every file that was read.
    fix_quality : mapping of quality in words to number of fixes
    cameras : tuple of str
        Those annotated.
    skipped : tuple of mapping
        What was left out, as JSON objects.
    """

    drive_id: str
    name: str
    started_ns: int
    ended_ns: int
    datum: str
    annotations_complete: bool
    n_frames: int
    n_annotations: int
    length_m: float
    delay_ms: float | None
    line: bytes
    rig_document: str
    poses: Poses
    content_sha256: str
    fix_quality: Mapping[str, int]
    cameras: tuple[str, ...]
    warnings: tuple[str, ...]
    skipped: tuple[Mapping[str, object], ...]
    software: str

    def to_row(self) -> dict[str, Any]:
        """Return its row of the table ``drive``."""
        row = {one.name: getattr(self, one.name) for one in fields(self)}
        for name in ("cameras", "warnings", "skipped"):
            row[name] = list(row[name])
        row["rig"] = zlib.compress(row.pop("rig_document").encode())
        return {**row, "poses": blob_from_poses(self.poses)}


@dataclass(frozen=True, slots=True)
class MethodRecord:
    """What one method found out about a drive: a row of ``drive_method``.

    Attributes
    ----------
    n_unplaced : int
        Annotated objects without a position that may stand near.
    corrections : Corrections or None
        None for methods that adjust nothing.
    misfits : tuple of Misfit
        In which ways the drive does not fit itself.
    absence_gap : str
        Why a sign that was not seen may stand all the same; "" where nothing speaks for that.
    """

    method: Method
    n_unplaced: int = 0
    corrections: Corrections | None = None
    misfits: tuple[Misfit, ...] = ()
    absence_gap: str = ""

    def to_row(self, drive_id: str) -> dict[str, Any]:
        """Return its row of the table ``drive_method``."""
        return {
            "drive_id": drive_id,
            "method": self.method.value,
            "n_unplaced": self.n_unplaced,
            "corrections": {} if self.corrections is None else self.corrections.to_json(),
            "misfits": [why_to_json(misfit) for misfit in self.misfits],
            "absence_gap": self.absence_gap,
        }


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """The sightings of a drive by one method, column by column, (n,) each: rows of ``sighting``.

    Attributes
    ----------
    epoch_ns : int64
        When it was seen, UTC.
    kind : str
        ``foot`` or ``box``.
    u_px, v_px, width_px, height_px : float64
        Pixel, and size of a box; NaN for a foot.
    east_m, north_m, cov_ee_m2, cov_en_m2, cov_nn_m2 : float64
        Where it alone puts the object, EPSG:25833; NaN where it does not.
    range_m, speed_mps : float64
    residual_u_px, residual_v_px, eye_east_m, eye_north_m : float64
        Of the adjustment alone.
    rejected : tuple of str
        Why it does not count; "" if it does.
    is_measured : bool
        False where the annotation tool interpolated it.
    """

    object: TextArray
    camera: TextArray
    frame: IntArray
    epoch_ns: IntArray
    kind: TextArray
    u_px: FloatArray
    v_px: FloatArray
    width_px: FloatArray
    height_px: FloatArray
    east_m: FloatArray
    north_m: FloatArray
    cov_ee_m2: FloatArray
    cov_en_m2: FloatArray
    cov_nn_m2: FloatArray
    range_m: FloatArray
    speed_mps: FloatArray
    residual_u_px: FloatArray
    residual_v_px: FloatArray
    eye_east_m: FloatArray
    eye_north_m: FloatArray
    rejected: tuple[str, ...]
    is_measured: BoolArray

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.rejected)

    @property
    def n_located(self) -> int:
        """How many count."""
        return self.rejected.count("")

    def columns(self) -> dict[str, list[Any]]:
        """Return Python values by column, None for NaN, which SQL has not."""
        return {one.name: _listed(getattr(self, one.name)) for one in fields(self)}

    def to_rows(self, drive_id: str, method: Method) -> list[dict[str, Any]]:
        """Return their rows of the table ``sighting``."""
        columns = self.columns()
        shared = {"drive_id": drive_id, "method": method.value}
        return [
            {**shared, "number": number, **dict(zip(columns, values, strict=True))}
            for number, values in enumerate(zip(*columns.values(), strict=True))
        ]


def _listed(values: Any) -> list[Any]:
    if not isinstance(values, np.ndarray):
        return list(values)
    listed: list[Any] = values.tolist()
    if values.dtype.kind != "f":
        return listed
    finite = np.isfinite(values).tolist()
    return [value if ok else None for value, ok in zip(listed, finite, strict=True)]
