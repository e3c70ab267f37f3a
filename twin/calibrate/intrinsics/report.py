"""What a calibration of intrinsics says of itself: a document for programs, and the same for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from geoloc.calibration.intrinsics.faults import some
from geoloc.calibration.intrinsics.fit import Fit
from geoloc.calibration.intrinsics.initial_guess import angle_between
from geoloc.rig.intrinsics import model_properties
from twin.calibrate.intrinsics.calibrate import Calibrated

_NINTHS = 3


def report_document(made: Calibrated, name: str) -> dict[str, Any]:
    """Everything that is known about the calibrated camera, ready for ``json.dumps``.

    Angles are in degrees, lengths in metres, pixels count from the centre of the first one.
    """
    intrinsics = made.intrinsics
    fit, coverage = intrinsics.fit, intrinsics.coverage
    return {
        "camera": name,
        "model": fit.label,
        "properties": model_properties(name, intrinsics.camera),
        "parameters": parameters(fit),
        "covariance": fit.covariance.tolist(),
        "residuals": _residuals(fit),
        "residuals_over_the_image": ninths(fit),
        "models": [
            {
                "model": c.label,
                "parameters": c.n_parameters,
                "held_out_rms_deg": _finite(c.held_out_deg),
                "chosen": c is intrinsics.chosen,
                "reason": c.reason,
            }
            for c in intrinsics.candidates
        ],
        "coverage": {
            "part_of_the_image": coverage.fraction,
            "hardly_covered": list(coverage.missing()),
            "ray_sigma_deg": {
                "median": _finite(np.nanmedian(intrinsics.sigma_deg)),
                "largest": _finite(np.nanmax(intrinsics.sigma_deg)),
            },
        },
        "board": {"text": made.board.text, "shape": _shape(fit)},
        "pictures": {
            "looked_at": made.n_pictures,
            "board_found": made.n_found,
            "used": len(intrinsics.views),
        },
        "views": views(made),
        "left_out": dict(intrinsics.left_out),
        "faults": [{"kind": fault.kind, "sentence": fault.sentence} for fault in made.faults],
    }


def parameters(fit: Fit) -> list[dict[str, Any]]:
    """Name, value and sigma of every parameter, as calibration files write it."""
    sigma = np.sqrt(np.diag(fit.covariance))
    rows = zip(fit.lens.parameters, fit.values.tolist(), sigma.tolist(), strict=True)
    return [{"name": name, "value": value, "sigma": one_sigma} for name, value, one_sigma in rows]


def views(made: Calibrated) -> list[dict[str, Any]]:
    """Where the board was in every view used, and how well its corners fit."""
    fit = made.intrinsics.fit
    corners, adjusted = fit.bundle.corners, fit.adjusted
    poses = adjusted.state.poses
    middle = poses.position_m + poses.rotation @ np.append(corners.middle_m, 0.0)
    tilt = angle_between(poses.rotation[:, :, 2], middle)
    square = np.sum(adjusted.residual_px**2, axis=1)
    table = []
    for number, name in enumerate(made.intrinsics.views):
        mine = corners.view == number
        used = mine & adjusted.inlier
        table.append(
            {
                "view": name,
                "corners": int(mine.sum()),
                "rejected": int((mine & ~adjusted.inlier).sum()),
                "rms_px": float(np.sqrt(0.5 * square[used].mean())),
                "distance_m": float(np.linalg.norm(middle[number])),
                "tilt_deg": float(np.degrees(tilt[number])),
                "edge_px": _finite(made.edge_px[name]),
            }
        )
    return table


def ninths(fit: Fit) -> list[dict[str, Any]]:
    """Residuals in ninths of the image: their mean (which should be nil) in pixels, RMS angle in degrees."""
    corners, adjusted = fit.bundle.corners, fit.adjusted
    size = np.array([fit.camera.width_px, fit.camera.height_px])
    part = np.clip((corners.pixel_px + 0.5) / size * _NINTHS, 0, _NINTHS - 1).astype(np.int64)
    angle_deg = np.degrees(fit.residuals_rad())
    table = []
    for row in range(_NINTHS):
        for column in range(_NINTHS):
            mine = adjusted.inlier & (part == (column, row)).all(axis=1)
            mean = adjusted.residual_px[mine].mean(axis=0) if mine.any() else np.full(2, np.nan)
            rms = np.sqrt(np.mean(angle_deg[mine] ** 2)) if mine.any() else np.nan
            name = f"{('top', 'middle', 'bottom')[row]} {('left', 'middle', 'right')[column]}"
            table.append(
                {
                    "part": name,
                    "corners": int(mine.sum()),
                    "mean_px": [_finite(value) for value in mean],
                    "rms_deg": _finite(rms),
                }
            )
    return table


def _residuals(fit: Fit) -> dict[str, Any]:
    angle_deg = np.degrees(fit.residuals_rad()[fit.adjusted.inlier])
    return {
        "corners": len(fit.adjusted.inlier),
        "rejected": int((~fit.adjusted.inlier).sum()),
        "sigma_px": fit.adjusted.sigma_px,
        "rms_deg": float(np.sqrt(np.mean(angle_deg**2))),
        "p95_deg": float(np.quantile(angle_deg, 0.95)),
        "max_deg": float(angle_deg.max()),
    }


def _shape(fit: Fit) -> dict[str, dict[str, float]]:
    return {name: {"value": value, "sigma": sigma} for name, (value, sigma) in fit.shape.items()}


def _finite(value: float | np.floating[Any]) -> float | None:
    return float(value) if np.isfinite(value) else None


def report_markdown(document: Mapping[str, Any], pictures: Sequence[str]) -> str:
    """Write the document for people, with its pictures."""
    faults = [f"- {fault['sentence']}" for fault in document["faults"]] or ["None found."]
    left_out = [f"- {line}" for line in left_out_lines(document["left_out"])]
    parts = {
        "Faults": faults,
        "Parameters": _parameter_table(document["parameters"]),
        "Models, compared by views left out of the fit": _model_table(document["models"]),
        "Coverage": [_covered(document["coverage"]), "", *(f"![{f}]({f})" for f in pictures)],
        "Residuals over the image": _residual_table(document["residuals_over_the_image"]),
        "Views": _view_table(document["views"]),
        "Views left out": left_out or ["None."],
    }
    lines = [f"# Camera {document['camera']}: {document['model']}", "", _summary(document)]
    for title, content in parts.items():
        lines += ["", f"## {title}", *content]
    return "\n".join(lines) + "\n"


def left_out_lines(left_out: Mapping[str, str]) -> list[str]:
    """Names of up to five views a reason, and how many more there are."""
    names: dict[str, list[str]] = {}
    for name, reason in left_out.items():
        names.setdefault(reason, []).append(name)
    return [f"{some(views)}: {reason}" for reason, views in names.items()]


def _parameter_table(parameters: Sequence[Mapping[str, Any]]) -> list[str]:
    rows = [(p["name"], f"{p['value']:.9g}", f"{p['sigma']:.2g}") for p in parameters]
    return _table(["parameter", "value", "one sigma"], rows)


def _model_table(models: Sequence[Mapping[str, Any]]) -> list[str]:
    rows = [
        (
            m["model"],
            m["parameters"],
            _degrees(m["held_out_rms_deg"]),
            "chosen" if m["chosen"] else m["reason"],
        )
        for m in models
    ]
    return _table(["model", "parameters", "held-out RMS [°]", ""], rows)


def _residual_table(parts: Sequence[Mapping[str, Any]]) -> list[str]:
    rows = [(p["part"], p["corners"], _pair(p["mean_px"]), _degrees(p["rms_deg"])) for p in parts]
    return _table(["part", "corners", "mean [px]", "RMS [°]"], rows)


def _view_table(seen: Sequence[Mapping[str, Any]]) -> list[str]:
    rows = [
        (
            v["view"],
            v["corners"],
            f"{v['rms_px']:.3f}",
            f"{v['distance_m']:.2f}",
            f"{v['tilt_deg']:.0f}",
            "–" if v["edge_px"] is None else f"{v['edge_px']:.1f}",
        )
        for v in seen
    ]
    return _table(["view", "corners", "RMS [px]", "distance [m]", "tilt [°]", "edge [px]"], rows)


def _summary(document: Mapping[str, Any]) -> str:
    pictures, residuals = document["pictures"], document["residuals"]
    return (
        f"{pictures['used']} of {pictures['looked_at']} pictures used, {residuals['corners']} corners "
        f"({residuals['rejected']} rejected) of the board `{document['board']['text']}`. A corner is good to "
        f"{residuals['sigma_px']:.3f} px; the angle to where it should be is {residuals['rms_deg']:.4f}° "
        f"(RMS), {residuals['max_deg']:.4f}° at most."
    )


def _covered(coverage: Mapping[str, Any]) -> str:
    sigma = coverage["ray_sigma_deg"]
    return (
        f"Boards cover {coverage['part_of_the_image']:.0%} of the image. There a ray is known to "
        f"{_degrees(sigma['median'])}° (median of one sigma), {_degrees(sigma['largest'])}° at worst. "
        "**Nothing is vouched for outside.**"
    )


def _table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> list[str]:
    lines = [header, ["---"] * len(header), *rows]
    return [f"| {' | '.join(str(cell) for cell in line)} |" for line in lines]


def _degrees(value: float | None) -> str:
    return "–" if value is None else f"{value:.4f}"


def _pair(values: Sequence[float | None]) -> str:
    return ", ".join("–" if value is None else f"{value:+.3f}" for value in values)
