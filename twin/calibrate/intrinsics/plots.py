"""Pictures of a calibration: residuals over the image, what is covered, and the lens's curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.calibration.intrinsics import CELL_PX, Fit, Intrinsics, angle_between
from geoloc.cameras import CameraModel
from twin.figures import png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_USED, _REJECTED, _OUTSIDE = "#1f5fa8", "#c8452e", "#d9d9d9"
_ARROW_PART = 0.02
"""Length of the arrow of a usual residual, as part of the image's width."""
_COLOURS = ("#1f5fa8", "#d98c21", "#3f8f4f", "#8a4fa3", "#7a7a7a", "#c8452e")


def residual_picture(result: Intrinsics) -> bytes:
    """Draw every corner's residual as an arrow, its angle as a colour, over the image (PNG)."""
    fit = result.fit
    figure, axes = _image_axes(fit.camera)
    adjusted, pixel = fit.adjusted, fit.bundle.corners.pixel_px
    used = adjusted.inlier
    scale = _round(_ARROW_PART * fit.camera.width_px / max(adjusted.sigma_px, 1e-9) / 1.2)
    angle_deg = np.degrees(fit.residuals_rad())
    arrows = axes.quiver(
        *pixel[used].T,
        *(scale * adjusted.residual_px[used]).T,
        angle_deg[used],
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.0015,
        cmap="viridis",
        # Thin edges in all shades would make a picture of half a megabyte.
        antialiased=False,
    )
    axes.plot(*pixel[~used].T, "x", color=_REJECTED, ms=5, label=f"rejected ({(~used).sum()})")
    figure.colorbar(arrows, ax=axes, label="angle [°]", fraction=0.03, pad=0.02)
    length = _ARROW_PART * fit.camera.width_px / scale
    axes.set_title(
        f"Residuals: {used.sum():,} corners, {len(result.views)} views; arrows {scale:,.4g} times enlarged, "
        f"{length:.3f} px is {_ARROW_PART:.0%} of the width",
        loc="left",
        fontsize=9,
    )
    if not used.all():
        figure.legend(fontsize=8, loc="outside lower left")
    return png(figure)


def _round(value: float) -> float:
    """Take the nearest of 1, 2, 5, 10 and so on."""
    ten = 10.0 ** np.floor(np.log10(value))
    return float(ten * min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(np.log(value / ten / step))))


def coverage_picture(result: Intrinsics) -> bytes:
    """Draw one sigma of the rays where boards were seen; grey is what is not vouched for (PNG)."""
    camera = result.camera
    figure, axes = _image_axes(camera)
    rows, columns = result.coverage.covered.shape
    extent = (-0.5, columns * CELL_PX - 0.5, rows * CELL_PX - 0.5, -0.5)
    axes.set_facecolor(_OUTSIDE)
    shown = axes.imshow(result.sigma_deg, extent=extent, cmap="viridis_r", vmin=0.0, interpolation="nearest")
    axes.plot(*result.fit.bundle.corners.pixel_px.T, ".", color="black", ms=1.2, alpha=0.5)
    axes.set(xlim=(-0.5, camera.width_px - 0.5), ylim=(camera.height_px - 0.5, -0.5))
    figure.colorbar(shown, ax=axes, label="one sigma of a ray [°]", fraction=0.03, pad=0.02)
    axes.set_title(
        f"Coverage: {result.coverage.fraction:.0%} of the image lies inside a board's outline; grey is not "
        "vouched for",
        loc="left",
        fontsize=9,
    )
    return png(figure)


def curve_picture(result: Intrinsics) -> bytes:
    """Draw θ(r) of the chosen model, and how far every other model that fits is from it (PNG)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.2), facecolor="white", layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    radius, theta = _curve(result.camera, result.fit.values[:2])
    seen = result.fit.bundle.corners.pixel_px[result.fit.adjusted.inlier] - result.fit.values[:2]
    farthest = float(np.linalg.norm(seen, axis=1).max())
    upper.plot(radius, theta, color=_COLOURS[0], lw=2, label=f"{result.fit.label} (chosen)")
    upper.plot(radius, radius * theta[1] / radius[1], color="#999999", lw=1, ls=":", label="proportional")
    upper.set_ylabel("angle from the axis θ [°]")
    others = [c.fit for c in result.candidates if c.fit is not None and c.fit is not result.fit]
    for colour, other in zip(_COLOURS[1:], others, strict=False):
        apart = _difference_deg(result.fit, other, radius)
        lower.plot(radius, apart, lw=1.3, color=colour, label=other.label)
    lower.set(xlabel="radius r from the principal point [px]", ylabel="from the chosen [°]")
    lower.axhline(0.0, color="#888888", lw=0.8)
    known = [line.get_ydata()[radius <= farthest] for line in lower.get_lines()[:-1]]
    largest = max((float(np.nanmax(np.abs(y), initial=0.0)) for y in known if len(y)), default=0.0)
    lower.set_ylim(-1.3 * max(min(largest, 0.2), 1e-3), 1.3 * max(min(largest, 0.2), 1e-3))
    for axes in (upper, lower):
        axes.axvspan(farthest, float(radius[-1]), color=_OUTSIDE, zorder=0)
        axes.grid(alpha=0.3)
        axes.margins(x=0.0)
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.4)
    upper.set_title("The lens: angle over radius; grey: beyond all corners", loc="left", fontsize=9.5)
    return png(figure)


def _curve(camera: CameraModel, centre_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Radius in pixels to the farthest corner of the image, and the angle there in degrees (NaN: no ray)."""
    size = np.array([camera.width_px, camera.height_px])
    farthest = float(np.linalg.norm(np.maximum(centre_px, size - centre_px)))
    radius = np.linspace(0.0, farthest, 200)
    return radius, _theta_deg(camera, centre_px, radius).mean(axis=1)


def _theta_deg(camera: CameraModel, centre_px: FloatArray, radius_px: FloatArray) -> FloatArray:
    """Angles (n, 8) from the axis at a radius in eight directions."""
    azimuth = np.arange(8) * np.pi / 4.0
    across = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    ray, _ = camera.camera_ray_from_pixel(centre_px + radius_px[:, np.newaxis, np.newaxis] * across)
    return np.degrees(angle_between(ray, np.array([0.0, 0.0, 1.0])))


def _difference_deg(fit: Fit, other: Fit, radius_px: FloatArray) -> FloatArray:
    """Mean difference of the angles from the axis; each model has its own centre and axis."""
    mine = _theta_deg(fit.camera, fit.values[:2], radius_px)
    return np.asarray((_theta_deg(other.camera, other.values[:2], radius_px) - mine).mean(axis=1))


def _image_axes(camera: CameraModel) -> tuple[Figure, Axes]:
    """Axes that are the image, with its pixels as units."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 7.0 * camera.height_px / camera.width_px + 0.5), layout="compressed")
    axes = figure.add_subplot()
    axes.set(xlim=(-0.5, camera.width_px - 0.5), ylim=(camera.height_px - 0.5, -0.5), aspect="equal")
    axes.tick_params(labelsize=7.5)
    return figure, axes
