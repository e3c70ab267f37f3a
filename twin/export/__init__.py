"""Layers for QGIS and for other programs: GeoPackage, GeoJSON and a picture.

>>> from twin.export import ExportLayers, empty_layers, export_all, render_png
"""

from twin.export.export import decide_as_in, export_findings
from twin.export.folder import FILES, export_all
from twin.export.geopackage import edited_decisions
from twin.export.layers import COLUMNS, ExportLayers, empty_layers
from twin.export.picture.picture import render_png

__all__ = [
    "COLUMNS",
    "FILES",
    "ExportLayers",
    "decide_as_in",
    "edited_decisions",
    "empty_layers",
    "export_all",
    "export_findings",
    "render_png",
]
