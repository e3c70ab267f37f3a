"""All sensors of a drive on one timeline, as text and as a picture."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from twin.drives.epochs import utc_text
from twin.drives.inspection.inspect import Inspection
from twin.drives.inspection.sensors import SensorSpan
from twin.errors import ConfigError
from twin.store.figure_files import check_figure_name, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_NS_PER_S = 1e9
_COLOURS = {
    "GNSS": "#1f6f8b",
    "poses": "#1f6f8b",
    "motion": "#8f5fa8",
    "frames": "#6a994e",
    "annotations": "#c8553d",
}
_GAP = "#cc3311"
_FULL, _PART, _NOTHING = "█", "▒", "·"
_MOST_MARKS = 4000


def text_timeline(sensors: Sequence[SensorSpan], columns: int = 40) -> list[str]:
    """One line of `columns` characters a sensor, all over the same span: full, with a gap, or nothing."""
    if not sensors:
        return []
    first, last = _span(sensors)
    edges = np.linspace(first, last, columns + 1)
    return ["".join(_cell(sensor, *pair) for pair in itertools.pairwise(edges)) for sensor in sensors]


def draw_timeline(inspection: Inspection, path: Path | str) -> Path:
    """Draw the timeline as a PNG, SVG or PDF: a bar a sensor, gaps in red, annotations as ticks.

    Raises
    ------
    ConfigError
        If the name has another ending, or there is nothing to draw.
    RefusedError
        If it cannot be written.
    """
    from matplotlib.figure import Figure

    path = check_figure_name(path)
    if not inspection.sensors:
        raise ConfigError(f"Nothing in {inspection.path} has a time, so there is no timeline to draw.")
    height = 1.4 + 0.42 * len(inspection.sensors)
    figure = Figure(figsize=(11.0, height), dpi=120, facecolor="white", layout="constrained")
    axes = figure.subplots()
    first, last = _span(inspection.sensors)
    for row, sensor in enumerate(inspection.sensors):
        _draw(axes, sensor, -row, first)
    labels = [f"{s.name}  {s.kind}" for s in inspection.sensors]
    axes.set_yticks(range(0, -len(labels), -1), labels, fontsize=9)
    axes.set(xlabel=f"seconds since {utc_text(first)}", ylim=(0.6 - len(labels), 0.6))
    axes.margins(x=0.01)
    axes.set_title(f"{inspection.name}: {(last - first) / _NS_PER_S:.1f} s", loc="left", fontsize=11)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(left=False)
    axes.grid(axis="x", color="#e6e6e6")
    axes.set_axisbelow(True)
    return write_figure(figure, path)


def told(sensor: SensorSpan) -> str:
    """Rate, gaps, delay and quality of a sensor in a few words."""
    if sensor.kind == "annotations":
        return f"{sensor.count:,}"
    words = [f"{sensor.count:,}"]
    if sensor.rate_hz is not None:
        words.append(f"{sensor.rate_hz:.1f} Hz")
    if sensor.n_gaps:
        longest = max(gap.seconds for gap in sensor.gaps)
        words.append(f"{sensor.n_gaps} gap{'s' if sensor.n_gaps > 1 else ''}, longest {longest:.1f} s")
    if sensor.delay_ms is not None:
        words.append(f"{sensor.delay_ms:.0f} ± {sensor.delay_spread_ms:.0f} ms late")
    if sensor.quality:
        best = max(sensor.quality, key=lambda name: sensor.quality[name])  # type: ignore[index]
        words.append(f"{sensor.quality[best] / sensor.count:.0%} {best}")
    if sensor.unit is not None:
        words.append(sensor.unit)
    if sensor.of_fixes is not None:
        words.append(f"{sensor.of_fixes:.3f} of the fixes'")
    if sensor.late_s is not None:
        words.append(f"{sensor.late_s:+.2f} s late")
    words += [
        f"{n:,} {what}" for n, what in ((sensor.headings, "headings"), (sensor.velocities, "velocities")) if n
    ]
    return ", ".join(words)


def _draw(axes: Axes, sensor: SensorSpan, row: int, first_ns: int) -> None:
    colour = _COLOURS[sensor.kind]
    seconds = (sensor.epoch_ns - first_ns) / _NS_PER_S
    if sensor.kind == "annotations":
        step = max(1, len(seconds) // _MOST_MARKS)
        axes.vlines(seconds[::step], row - 0.22, row + 0.22, color=colour, lw=0.8)
    else:
        axes.barh(row, seconds[-1] - seconds[0], left=seconds[0], height=0.34, color=colour)
        for gap in sensor.gaps:
            axes.barh(
                row, gap.seconds, left=(gap.first_ns - first_ns) / _NS_PER_S, height=0.34, color="white"
            )
            axes.plot((gap.first_ns - first_ns) / _NS_PER_S, row, "|", color=_GAP, ms=12, mew=1.5)
    axes.text(seconds[0], row + 0.24, told(sensor), fontsize=7.5, color="#444444", va="bottom")


def _cell(sensor: SensorSpan, start: float, end: float) -> str:
    low, high = np.searchsorted(sensor.epoch_ns, [start, end])
    inside = sensor.first_ns <= end and sensor.last_ns >= start
    if sensor.kind == "annotations":
        return _FULL if high > low else _NOTHING
    if not inside:
        return _NOTHING
    broken = any(gap.first_ns < end and gap.last_ns > start for gap in sensor.gaps)
    return _PART if broken else _FULL


def _span(sensors: Sequence[SensorSpan]) -> tuple[int, int]:
    return min(s.first_ns for s in sensors), max(s.last_ns for s in sensors)
