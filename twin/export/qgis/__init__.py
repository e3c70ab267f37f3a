"""Styles, map tips and the project that QGIS opens."""
