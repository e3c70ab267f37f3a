"""Draw docs/images/fleet.png: what runs where in a fleet, and what goes from one to the other.

Usage: python tools/fleet_picture.py
"""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

BOXES = {
    "cars": (0.2, 7.0, 2.9, 1.5, "Cars", "recorded drives,\nannotated or detected"),
    "drives": (3.9, 7.0, 3.1, 1.5, "Drives", "a folder, s3://, az://,\nhttps://, through fsspec"),
    "workers": (
        7.9,
        6.6,
        3.6,
        1.9,
        "Workers, on any machine",
        "twin fleet work --stay\nlocate(drive) → rows,\na process a core; or Dask",
    ),
    "nvdb": (0.2, 3.5, 2.9, 1.2, "NVDB", "Les V4, API Skriv"),
    "store": (
        3.9,
        3.0,
        7.6,
        2.1,
        "One store: PostgreSQL with PostGIS (or one file of SQLite)",
        (
            "queue · drives and sightings · estimates · what matching keeps\n"
            "mirror of NVDB and its history · findings · decisions, only added to\n\n"
            "writers take turns; readers see one state and wait for nobody"
        ),
    ),
    "people": (3.9, 0.9, 3.5, 1.1, "People", "twin review, QGIS"),
    "night": (0.2, 0.9, 2.9, 1.1, "Night, by cron", "twin sync-nvdb, match"),
    "watch": (8.0, 0.9, 3.5, 1.1, "Whoever runs it", "twin status --prometheus"),
}
ARROWS = [
    ((3.1, 7.75), (3.9, 7.75), "copied\nwhole", (3.5, 8.1)),
    ((7.0, 7.75), (7.9, 7.75), "read", (7.45, 7.95)),
    ((8.7, 6.6), (8.7, 5.1), "rows and “done”:\none transaction", (7.75, 5.85)),
    ((10.0, 5.1), (10.0, 6.6), "claim for a minute,\nrenewed", (10.95, 5.85)),
    ((5.2, 7.0), (5.2, 5.1), "twin fleet ingest:\naddresses", (4.3, 6.1)),
    ((3.1, 4.4), (3.9, 4.4), "signs", (3.5, 4.6)),
    ((3.9, 3.8), (3.1, 3.8), "changes", (3.5, 3.55)),
    ((1.65, 2.0), (1.65, 3.5), "", (0, 0)),
    ((3.1, 1.7), (4.5, 3.0), "", (0, 0)),
    ((5.9, 3.0), (5.9, 2.0), "findings", (5.35, 2.5)),
    ((6.5, 2.0), (6.5, 3.0), "decisions", (7.15, 2.5)),
    ((9.75, 3.0), (9.75, 2.0), "numbers", (10.3, 2.5)),
]


def main() -> None:
    """Draw it."""
    figure = Figure(figsize=(10, 6.6))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 11.8), ylim=(0.7, 8.7))
    axes.axis("off")
    for x, y, width, height, name, what in BOXES.values():
        face = "#e8f0f8" if name.startswith("One store") else "#f6f6f2"
        axes.add_patch(
            FancyBboxPatch(
                (x, y), width, height, boxstyle="round,pad=0,rounding_size=0.12", fc=face, ec="#33475b"
            )
        )
        top = {"va": "top", "ha": "center"}
        axes.text(x + width / 2, y + height - 0.18, name, weight="bold", size=10, **top)
        axes.text(x + width / 2, y + height - 0.55, what, size=9, color="#333333", linespacing=1.4, **top)
    for start, end, what, at in ARROWS:
        axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": "#33475b", "lw": 1.3})
        if what:
            axes.text(*at, what, size=8, color="#33475b", ha="center", va="center", style="italic")
    out = Path(__file__).resolve().parents[1] / "docs" / "images" / "fleet.png"
    figure.savefig(out, dpi=120, metadata={"Software": None})


if __name__ == "__main__":
    main()
