"""The reliability diagram: how often findings of a confidence were right."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from twin.export.appearance import MARK
from twin.reports.confidences import ENOUGH, ConfidenceReport, Score
from twin.store.figure_files import check_figure_name, write_figure
from twin.words import Lang, say, verdict_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ALL = "#33516e"
_FEW = 3
"""Panels in one row."""


def draw_confidences(report: ConfidenceReport, path: Path, lang: Lang = Lang.EN) -> Path:
    """Draw a panel for all verdicts together and for each with enough decisions.

    Each bin has a bar at its mean confidence and a mark at the share that was right, with the 95 % interval
    of that and, on top, the number of findings: where the interval holds the bar, confidences may be true.
    The bins stand side by side, since most findings are near 100 %. Colours are those of the map (Okabe and
    Ito's, told apart by the colour-blind), and every panel has its title.

    Parameters
    ----------
    report : ConfidenceReport
    path : Path
        PNG, SVG or PDF, by its ending; replaced atomically.
    lang : Lang, optional

    Raises
    ------
    ConfigError
        The name has another ending.
    """
    from matplotlib.figure import Figure

    check_figure_name(path)
    shown = [one for one in report.scores if one.n and (not one.verdict or one.n >= ENOUGH)]
    columns = min(max(len(shown), 1), _FEW)
    rows = -(-max(len(shown), 1) // columns)
    figure = Figure(figsize=(4.2 * columns, 4.4 * rows), dpi=120, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for ax, one in zip(axes, shown, strict=False):
        _panel(ax, one, lang)
    for ax in axes[len(shown) :]:
        ax.set_axis_off()
    return write_figure(figure, path)


def _panel(ax: Axes, one: Score, lang: Lang) -> None:
    colour = MARK[one.verdict].colour if one.verdict else _ALL
    title = verdict_title(one.verdict, lang) if one.verdict else say(lang, "confidence.all")
    for x, each in enumerate(one.bins):
        said = each.mean_confidence
        ax.plot([x - 0.35, x + 0.35], [said, said], color="black", linewidth=2, zorder=2)
        ax.plot([x, x], [each.low, each.high], color=colour, linewidth=2, zorder=1)
        ax.plot([x], [each.share_right], "o", color=colour, markeredgecolor="black", markersize=8, zorder=3)
        ax.annotate(f"{each.n}", (x, 1.05), ha="center", fontsize=8)
    if one.brier is not None:
        title = f"{title}: {say(lang, 'confidence.brier_is', brier=one.brier)}"
    ax.set_title(title, fontsize=10)
    edges = [(one_bin.from_confidence, one_bin.to_confidence) for one_bin in one.bins]
    labels = [say(lang, "confidence.between", low=low, high=high) for low, high in edges]
    ax.set_xticks(range(len(labels)), labels, rotation=45, ha="right", fontsize=8)
    ticks = [0.0, 0.25, 0.5, 0.75, 1.0]
    ax.set_yticks(ticks, [say(lang, "confidence.share", share=tick) for tick in ticks], fontsize=8)
    ax.set_xlabel(say(lang, "confidence.said"))
    ax.set_ylabel(say(lang, "confidence.was"))
    ax.set_xlim(-0.6, max(len(labels), 1) - 0.4)
    ax.set_ylim(-0.02, 1.12)
    ax.grid(axis="y", color="0.9")
    ax.set_axisbelow(True)
