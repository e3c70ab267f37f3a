"""Layers for QGIS and for other programs: GeoPackage, GeoJSON and a picture.

>>> from twin.export import ExportLayers, empty_layers, export_all, render_map
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
