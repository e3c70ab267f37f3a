"""What is told of each object: the columns of the files and of ``--json``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoloc.locate.combine import ellipse
from geoloc.locate.outlines import Measure
from twin.objects.against_nvdb import Compared
from twin.objects.locate import GroundObject

_DECIMALS = 4


@dataclass(frozen=True, slots=True)
class ObjectRow:
    """One object on the ground.

    Attributes
    ----------
    object : str
        The annotator's id, or one of the drawing that knows it best.
    label : str
    nvdb_type : int or None
        Vegobjekttype that ``labels.toml`` gives the label.
    kind : str
        ``point``, ``line`` or ``area``.
    length_m, length_sigma_m : float or None
        Of lines, metres, and one sigma.
    area_m2, area_sigma_m2 : float or None
        Of areas, square metres, and one sigma.
    is_whole : bool
        Whether both ends of a line were seen: it is longer than its length where not.
    sigma_major_m : float
        Longest axis of the one-sigma ellipses of its corners, metres.
    range_min_m : float
        Of its corners from the camera, metres.
    n_corners : int
    n_drawn, n_used : int
        Drawings of it, and those that its place comes from.
    camera : str
        Of the drawing that knows it best.
    frame : int
        Likewise.
    """

    object: str
    label: str
    nvdb_type: int | None
    kind: str
    length_m: float | None
    length_sigma_m: float | None
    area_m2: float | None
    area_sigma_m2: float | None
    is_whole: bool
    sigma_major_m: float
    range_min_m: float
    n_corners: int
    n_drawn: int
    n_used: int
    camera: str
    frame: int

    @classmethod
    def of(cls, one: GroundObject) -> ObjectRow:
        """Return the row of an object."""
        length, area = _measure(one.length), _measure(one.area)
        return cls(
            *(one.object, one.label, one.nvdb_type, one.kind, *length, *area, one.is_whole),
            sigma_major_m=rounded(float(np.max(ellipse(one.outline.corner_m2)[0]))) or 0.0,
            range_min_m=rounded(float(np.min(one.outline.range_m))) or 0.0,
            n_corners=len(one.outline.own_m2),
            n_drawn=one.n_drawn,
            n_used=one.n_used,
            camera=one.camera,
            frame=one.frame,
        )


@dataclass(frozen=True, slots=True)
class ComparedRow:
    """One object of NVDB with what was found of it, or one that NVDB does not have.

    Attributes
    ----------
    verdict : str
        ``new``, ``found``, ``size differs``, ``missing``, ``not drawn`` or ``not seen``.
    nvdb_type : int
    nvdb_id : str
        "" of what is new.
    objects : str
        Ours, joined by ``;``.
    distance_m, sigma_m : float or None
        Between the two geometries, metres, and one sigma.
    nvdb_size : float or None
        Length or area in NVDB, metres or square metres.
    seen_size : float or None
        What of a line of NVDB's was in view, metres.
    found_size : float or None
        What of it was found; of areas and of what is new, all of ours.
    beyond_m : float or None
        What of ours goes on beyond NVDB's line, metres.
    size_sigma : float or None
        One sigma of the difference in size.
    """

    verdict: str
    nvdb_type: int
    nvdb_id: str
    objects: str
    distance_m: float | None
    sigma_m: float | None
    nvdb_size: float | None
    seen_size: float | None
    found_size: float | None
    beyond_m: float | None
    size_sigma: float | None

    @classmethod
    def of(cls, one: Compared) -> ComparedRow:
        """Return the row of a comparison."""
        return cls(
            *(str(one.verdict), one.nvdb_type, one.nvdb_id, ";".join(one.objects)),
            *(rounded(one.distance_m), rounded(one.sigma_m), rounded(one.nvdb_size)),
            *(rounded(one.seen_size), rounded(one.found_size), rounded(one.beyond_m)),
            rounded(one.size_sigma),
        )


@dataclass(frozen=True, slots=True)
class ObjectsReport:
    """What `twin objects` tells.

    Attributes
    ----------
    drive : str
        Its name.
    n_drawn : int
        Drawings on the ground that were read.
    objects : list of ObjectRow
    left_out : dict of str to int
        Drawings without a place, by reason.
    compared : list of ComparedRow
        Empty without ``--nvdb``.
    nvdb_left_out : int
        Objects of NVDB without a geometry of their own.
    nvdb_elsewhere : int
        Objects of NVDB further than 30 m from where the car drove.
    warnings : list of str
    files : list of str
        Those that were written.
    """

    drive: str
    n_drawn: int
    objects: list[ObjectRow]
    left_out: dict[str, int]
    compared: list[ComparedRow]
    nvdb_left_out: int
    nvdb_elsewhere: int
    warnings: list[str]
    files: list[str]


def rounded(value: float | None) -> float | None:
    """Return a number to a tenth of a millimetre, or None for NaN and none."""
    return None if value is None or not np.isfinite(value) else round(float(value), _DECIMALS)


def _measure(measure: Measure | None) -> tuple[float | None, float | None]:
    return (None, None) if measure is None else (rounded(measure.value), rounded(measure.sigma))
