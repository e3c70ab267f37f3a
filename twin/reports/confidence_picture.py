"""The reliability diagram: how often findings of a confidence were right."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from twin.errors import ConfigError
from twin.export.appearance import MARK
from twin.figures import png, svg
from twin.reports.confidences import ENOUGH, ConfidenceReport, Score
from twin.store.atomic_files import replace_file
from twin.store.folders import make_folder
from twin.words import Lang, say, verdict_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ALL = "#33516e"
_FEW = 3
"""Panels in one row."""


def draw_confidences(report: ConfidenceReport, path: Path, lang: Lang = Lang.EN) -> Path:
    """Draw a panel for all verdicts together and for each with enough decisions.

    Each bin is a mark at its mean confidence, with the 95 % interval of the share that was right and the
    number of its findings; on the diagonal confidences are true. Colours are those of the map (Okabe and
    Ito's, told apart by the colour-blind), and every panel has its title.

    Parameters
    ----------
    report : ConfidenceReport
    path : Path
        PNG or SVG, by its ending; replaced atomically.
    lang : Lang, optional

    Raises
    ------
    ConfigError
        The ending is neither.
    """
    from matplotlib.figure import Figure

    write = {".png": png, ".svg": svg}.get(path.suffix.lower())
    if write is None:
        raise ConfigError(f"The figure {path} is neither a PNG nor an SVG: let its name end in .png or .svg.")
    shown = [one for one in report.scores if one.n and (not one.verdict or one.n >= ENOUGH)]
    columns = min(max(len(shown), 1), _FEW)
    rows = -(-max(len(shown), 1) // columns)
    figure = Figure(figsize=(4.2 * columns, 4.4 * rows), dpi=120, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for ax, one in zip(axes, shown, strict=False):
        _panel(ax, one, lang)
    for ax in axes[len(shown) :]:
        ax.set_axis_off()
    make_folder(path.parent)
    replace_file(path, write(figure))
    return path


def _panel(ax: Axes, one: Score, lang: Lang) -> None:
    colour = MARK[one.verdict].colour if one.verdict else _ALL
    title = verdict_title(one.verdict, lang) if one.verdict else say(lang, "confidence.all")
    ax.plot([0, 1], [0, 1], color="0.6", linewidth=1, linestyle="--", zorder=1)
    for each in one.bins:
        x, y = each.mean_confidence, each.share_right
        ax.plot([x, x], [each.low, each.high], color=colour, linewidth=1.5, zorder=2)
        ax.plot([x], [y], "o", color=colour, markeredgecolor="black", markersize=7, zorder=3)
        side = (6, "left") if x < 0.85 else (-6, "right")
        ax.annotate(
            f"{each.n}", (x, y), xytext=(side[0], -3), textcoords="offset points", ha=side[1], fontsize=8
        )
    if one.brier is not None:
        title = f"{title}: {say(lang, 'confidence.brier_is', brier=one.brier)}"
    ax.set_title(title, fontsize=10)
    ax.set_xlabel(say(lang, "confidence.said"))
    ax.set_ylabel(say(lang, "confidence.was"))
    ax.set_xlim(-0.02, 1.02)
    ax.set_ylim(-0.02, 1.02)
    ax.set_aspect("equal")
