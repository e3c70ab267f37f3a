"""Figures as PNG and SVG files, the same bytes at every run."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def png(figure: Figure) -> bytes:
    """Draw a figure with matplotlib's own renderer, as its size and dpi say.

    The program's version is left out of the file: the same data give the same bytes for longer.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    image = io.BytesIO()
    figure.savefig(image, format="png", metadata={"Software": None})
    return image.getvalue()


def svg(figure: Figure) -> bytes:
    """Write a figure as SVG, its letters as outlines: it looks alike whatever fonts the reader has."""
    import matplotlib as mpl
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    FigureCanvasSVG(figure)
    drawing = io.BytesIO()
    # Ids of clips and marks come of this salt, not of chance.
    with mpl.rc_context({"svg.hashsalt": "twin"}):
        figure.savefig(drawing, format="svg", metadata={"Date": None, "Creator": None})
    return drawing.getvalue()
