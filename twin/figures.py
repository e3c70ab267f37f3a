"""Figures as PNG, SVG and PDF files, the same bytes at every run."""

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
    _lay_out(figure)
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


def pdf(figure: Figure) -> bytes:
    """Write a figure as PDF, for print; its letters stay letters, in a font that the file brings along."""
    import matplotlib as mpl
    from matplotlib.backends.backend_pdf import FigureCanvasPdf

    FigureCanvasPdf(figure)
    page = io.BytesIO()
    # Type 3, matplotlib's own choice, is refused by some journals.
    with mpl.rc_context({"pdf.fonttype": 42}):
        figure.savefig(page, format="pdf", metadata={"CreationDate": None, "Creator": None, "Producer": None})
    return page.getvalue()


def _lay_out(figure: Figure) -> None:
    """Put titles and scales where they have room: savefig does the same, and draws everything for it."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        figure.set_layout_engine(None)


FORMATS = {".png": png, ".svg": svg, ".pdf": pdf}
"""Ending of a file's name → how a figure becomes its bytes."""
