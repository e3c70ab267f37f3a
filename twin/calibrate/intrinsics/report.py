"""What a calibration of intrinsics says of itself: records for programs, and the same for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from geoloc.calibration.intrinsics import Coverage, Fit, angle_between, some
from geoloc.calibration.intrinsics.coverage import map_pixels
from geoloc.doubts import Doubt
from geoloc.rig.intrinsics import model_properties
from twin.calibrate.intrinsics.calibrate import Calibrated
from twin.calibrate.result_files import COVERED

_NINTHS = 3


@dataclass(frozen=True, slots=True)
class ShapeTerm:
    """One adjusted part of the board's shape (`SHAPE`), with its sigma."""

    value: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of the camera model, as calibration files write it."""

    name: str
    value: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Residuals:
    """Corners of all views: how many, one sigma of a coordinate, and angles between rays."""

    corners: int
    rejected: int
    sigma_px: float
    rms_deg: float
    p95_deg: float
    max_deg: float


@dataclass(frozen=True, slots=True)
class PartResiduals:
    """Residuals in a ninth of the image: their mean, which should be nil, and the RMS angle; None without."""

    part: str
    corners: int
    mean_px: tuple[float | None, ...]
    rms_deg: float | None


@dataclass(frozen=True, slots=True)
class ComparedModel:
    """A model of the comparison; `reason` says why it failed."""

    model: str
    parameters: int
    held_out_rms_deg: float | None
    chosen: bool
    reason: str


@dataclass(frozen=True, slots=True)
class RaySigma:
    """One sigma of rays where boards were seen; None where it is not known."""

    median: float | None
    largest: float | None


@dataclass(frozen=True, slots=True)
class CoveredImage:
    """The part of the image that is vouched for, and the ninths of which it has less than half.

    Attributes
    ----------
    part_of_the_image : float
    hardly_covered : tuple of str
    ray_sigma_deg : RaySigma
    cells : tuple of str
        Rows of the image's cells of 32 pixels, from its top left corner: ``#`` where a board covers a cell's
        middle, ``.`` where none does.
    """

    part_of_the_image: float
    hardly_covered: tuple[str, ...]
    ray_sigma_deg: RaySigma
    cells: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BoardReport:
    """The board as ``--board`` has it, and what was adjusted of its shape."""

    text: str
    shape: Mapping[str, ShapeTerm]


@dataclass(frozen=True, slots=True)
class PictureCounts:
    """How many pictures there were, how many showed the board, how many were used."""

    looked_at: int
    board_found: int
    used: int


@dataclass(frozen=True, slots=True)
class ViewReport:
    """Where the board was in one view, and how well its corners fit."""

    view: str
    corners: int
    rejected: int
    rms_px: float
    distance_m: float
    tilt_deg: float
    edge_px: float | None


@dataclass(frozen=True, slots=True)
class IntrinsicsReport:
    """Everything that is known about a calibrated camera: ``report.json`` has these names.

    Angles are in degrees, lengths in metres, pixels count from the centre of the first one. `covariance` is
    that of `parameters`; `left_out` has a reason for each view; `faults` are what is wrong with the views.
    """

    camera: str
    model: str
    properties: Mapping[str, str]
    parameters: tuple[Parameter, ...]
    covariance: tuple[tuple[float, ...], ...]
    residuals: Residuals
    residuals_over_the_image: tuple[PartResiduals, ...]
    models: tuple[ComparedModel, ...]
    coverage: CoveredImage
    board: BoardReport
    pictures: PictureCounts
    views: tuple[ViewReport, ...]
    left_out: Mapping[str, str]
    faults: tuple[Doubt, ...]

    def document(self, files: object) -> dict[str, Any]:
        """Return the report for ``json.dumps``, with the files that were written."""
        return {**asdict(self), "files": files}


def intrinsics_report(calibrated: Calibrated, name: str) -> IntrinsicsReport:
    """Report on a calibrated camera of that name."""
    intrinsics = calibrated.intrinsics
    fit, coverage = intrinsics.fit, intrinsics.coverage
    return IntrinsicsReport(
        camera=name,
        model=fit.label,
        properties=model_properties(name, intrinsics.camera),
        parameters=_parameters(fit),
        covariance=tuple(map(tuple, fit.covariance.tolist())),
        residuals=_residuals(fit),
        residuals_over_the_image=_residuals_by_part(fit),
        models=tuple(
            ComparedModel(c.label, c.n_parameters, _finite(c.held_out_deg), c is intrinsics.chosen, c.reason)
            for c in intrinsics.candidates
        ),
        coverage=CoveredImage(
            coverage.fraction,
            coverage.missing(),
            RaySigma(_finite(np.nanmedian(intrinsics.sigma_deg)), _finite(np.nanmax(intrinsics.sigma_deg))),
            _cells(coverage),
        ),
        board=BoardReport(
            calibrated.board.text, {name: ShapeTerm(*estimate) for name, estimate in fit.shape.items()}
        ),
        pictures=PictureCounts(calibrated.n_pictures, calibrated.n_found, len(intrinsics.views)),
        views=_views(calibrated),
        left_out=dict(intrinsics.left_out),
        faults=calibrated.faults,
    )


def _cells(coverage: Coverage) -> tuple[str, ...]:
    covered = coverage.covers(map_pixels(coverage.width_px, coverage.height_px))
    return tuple("".join(COVERED if cell else "." for cell in row) for row in covered.tolist())


def _parameters(fit: Fit) -> tuple[Parameter, ...]:
    sigma = np.sqrt(np.diag(fit.covariance))
    rows = zip(fit.lens.parameters, fit.values.tolist(), sigma.tolist(), strict=True)
    return tuple(Parameter(*row) for row in rows)


def _views(calibrated: Calibrated) -> tuple[ViewReport, ...]:
    fit = calibrated.intrinsics.fit
    corners, adjusted = fit.bundle.corners, fit.adjusted
    poses = adjusted.state.poses
    middle = poses.position_m + poses.rotation @ np.append(corners.middle_m, 0.0)
    tilt = angle_between(poses.rotation[:, :, 2], middle)
    square = np.sum(adjusted.residual_px**2, axis=1)
    views = []
    for number, name in enumerate(calibrated.intrinsics.views):
        mine = corners.view == number
        used = mine & adjusted.inlier
        views.append(
            ViewReport(
                view=name,
                corners=int(mine.sum()),
                rejected=int((mine & ~adjusted.inlier).sum()),
                rms_px=float(np.sqrt(0.5 * square[used].mean())),
                distance_m=float(np.linalg.norm(middle[number])),
                tilt_deg=float(np.degrees(tilt[number])),
                edge_px=_finite(calibrated.edge_px[name]),
            )
        )
    return tuple(views)


def _residuals_by_part(fit: Fit) -> tuple[PartResiduals, ...]:
    corners, adjusted = fit.bundle.corners, fit.adjusted
    size = np.array([fit.camera.width_px, fit.camera.height_px])
    part = np.clip((corners.pixel_px + 0.5) / size * _NINTHS, 0, _NINTHS - 1).astype(np.int64)
    angle_deg = np.degrees(fit.residuals_rad())
    parts = []
    for row, down in enumerate(("top", "middle", "bottom")):
        for column, across in enumerate(("left", "middle", "right")):
            mine = adjusted.inlier & (part == (column, row)).all(axis=1)
            mean = adjusted.residual_px[mine].mean(axis=0) if mine.any() else np.full(2, np.nan)
            rms = np.sqrt(np.mean(angle_deg[mine] ** 2)) if mine.any() else np.nan
            mean_px = tuple(_finite(value) for value in mean)
            parts.append(PartResiduals(f"{down} {across}", int(mine.sum()), mean_px, _finite(rms)))
    return tuple(parts)


def _residuals(fit: Fit) -> Residuals:
    angle_deg = np.degrees(fit.residuals_rad()[fit.adjusted.inlier])
    return Residuals(
        corners=len(fit.adjusted.inlier),
        rejected=int((~fit.adjusted.inlier).sum()),
        sigma_px=fit.adjusted.sigma_px,
        rms_deg=float(np.sqrt(np.mean(angle_deg**2))),
        p95_deg=float(np.quantile(angle_deg, 0.95)),
        max_deg=float(angle_deg.max()),
    )


def _finite(value: float | np.floating[Any]) -> float | None:
    return float(value) if np.isfinite(value) else None


def report_markdown(report: IntrinsicsReport, pictures: Sequence[str]) -> str:
    """Write the report for people, with its pictures."""
    sections = {
        "Faults": [f"- {fault}" for fault in report.faults] or ["None found."],
        "Parameters": _table(
            ["parameter", "value", "one sigma"],
            [(p.name, f"{p.value:.9g}", f"{p.sigma:.2g}") for p in report.parameters],
        ),
        "Models, compared by views left out of the fit": _table(
            ["model", "parameters", "held-out RMS [°]", ""],
            [
                (m.model, m.parameters, _degrees(m.held_out_rms_deg), "chosen" if m.chosen else m.reason)
                for m in report.models
            ],
        ),
        "Coverage": [_covered(report.coverage), "", *(f"![{f}]({f})" for f in pictures)],
        "Residuals over the image": _table(
            ["part", "corners", "mean [px]", "RMS [°]"],
            [
                (p.part, p.corners, ", ".join(_number(v, "+.3f") for v in p.mean_px), _degrees(p.rms_deg))
                for p in report.residuals_over_the_image
            ],
        ),
        "Views": _table(
            ["view", "corners", "RMS [px]", "distance [m]", "tilt [°]", "edge [px]"],
            [
                (
                    *(v.view, v.corners, f"{v.rms_px:.3f}", f"{v.distance_m:.2f}", f"{v.tilt_deg:.0f}"),
                    _number(v.edge_px, ".1f"),
                )
                for v in report.views
            ],
        ),
        "Views left out": [f"- {line}" for line in left_out_lines(report.left_out)] or ["None."],
    }
    lines = [f"# Camera {report.camera}: {report.model}", "", _summary(report)]
    for title, content in sections.items():
        lines += ["", f"## {title}", *content]
    return "\n".join(lines) + "\n"


def left_out_lines(left_out: Mapping[str, str]) -> list[str]:
    """Names of up to five views a reason, and how many more there are."""
    names: dict[str, list[str]] = {}
    for name, reason in left_out.items():
        names.setdefault(reason, []).append(name)
    return [f"{some(views)}: {reason}" for reason, views in names.items()]


def _summary(report: IntrinsicsReport) -> str:
    pictures, residuals = report.pictures, report.residuals
    return (
        f"{pictures.used} of {pictures.looked_at} pictures used, {residuals.corners} corners "
        f"({residuals.rejected} rejected) of the board `{report.board.text}`. A corner is good to "
        f"{residuals.sigma_px:.3f} px; the angle to where it should be is {residuals.rms_deg:.4f}° "
        f"(RMS), {residuals.max_deg:.4f}° at most."
    )


def _covered(coverage: CoveredImage) -> str:
    sigma = coverage.ray_sigma_deg
    return (
        f"Boards cover {coverage.part_of_the_image:.0%} of the image. There a ray is known to "
        f"{_degrees(sigma.median)}° (median of one sigma), {_degrees(sigma.largest)}° at worst. "
        "**Nothing is vouched for outside.**"
    )


def _table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    lines = [header, ["---"] * len(header), *rows]
    return [f"| {' | '.join(str(cell) for cell in line)} |" for line in lines]


def _degrees(value: float | None) -> str:
    return _number(value, ".4f")


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else format(value, form)
