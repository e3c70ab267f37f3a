"""Open layers in QGIS without a screen, as QGIS Desktop would, and tell what a user would see.

Run by the system's Python, which has QGIS's bindings::

    /usr/bin/python3 tests/qgis_open_layer.py FILE.gpkg LAYER OUT.png [FILE.gpkg LAYER OUT.png ...]

Prints one JSON list, one object a layer. The default style is not loaded here: QGIS finds it in the file.
"""

from __future__ import annotations

import json
import os
import sys
from array import array
from collections import Counter
from typing import Any

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from qgis.core import (
    QgsApplication,
    QgsCategorizedSymbolRenderer,
    QgsExpression,
    QgsExpressionContext,
    QgsExpressionContextUtils,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsProject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtGui import QColor, QImage

WIDTH_PX, HEIGHT_PX = 800, 600


def render(layer: QgsVectorLayer, png: str) -> tuple[dict[str, int], list[str]]:
    """Draw the layer with its own style; return pixels by colour, and the errors."""
    settings = QgsMapSettings()
    settings.setLayers([layer])
    settings.setDestinationCrs(layer.crs())
    settings.setOutputSize(QSize(WIDTH_PX, HEIGHT_PX))
    settings.setBackgroundColor(QColor("white"))
    extent = layer.extent()
    # Not scale(): points in a row have no height, and QGIS draws nothing of that.
    extent.grow(0.1 * max(extent.width(), extent.height()) or 1e-4)
    settings.setExtent(extent)
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    image = job.renderedImage()
    image.save(png)
    pixels = array("I", image.convertToFormat(QImage.Format_RGB32).bits().asstring(4 * WIDTH_PX * HEIGHT_PX))
    count = {f"#{pixel & 0xFFFFFF:06x}": number for pixel, number in Counter(pixels).items()}
    return count, [error.message for error in job.errors()]


def symbols(layer: QgsVectorLayer) -> dict[str, list[str]]:
    """Value of a category ("" for a single symbol) → the fill and rim colours of its symbol layers."""
    renderer = layer.renderer()
    if isinstance(renderer, QgsCategorizedSymbolRenderer):
        # Clones: a category takes its symbol with it when Python lets go of it.
        pairs = [(category.value() or "", category.symbol().clone()) for category in renderer.categories()]
    else:
        pairs = [("", renderer.symbol())]
    return {
        str(value): [
            colour.name()
            for part in symbol.symbolLayers()
            for colour in (part.color(), part.strokeColor())
            if colour.isValid()
        ]
        for value, symbol in pairs
    }


def describe(path: str, name: str, png: str) -> dict[str, Any]:
    """Open one layer and tell what QGIS makes of it."""
    layer = QgsVectorLayer(f"{path}|layername={name}", name, "ogr")
    if not layer.isValid():
        return {"layer": name, "valid": False, "error": layer.error().summary()}
    form = layer.editFormConfig()
    fields = list(enumerate(layer.fields()))
    tips = []
    for feature in layer.getFeatures():
        context = QgsExpressionContext(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
        context.setFeature(feature)
        tips.append(QgsExpression.replaceExpressionText(layer.mapTipTemplate(), context))
    pixels, errors = render(layer, png)
    return {
        "layer": name,
        "valid": True,
        "features": layer.featureCount(),
        "crs": layer.crs().authid(),
        "renderer": layer.renderer().type(),
        "symbols": symbols(layer),
        "labels": layer.labelsEnabled(),
        "aliases": {field.name(): field.alias() for _, field in fields},
        "editable": [field.name() for index, field in fields if not form.readOnly(index)],
        "widgets": {field.name(): layer.editorWidgetSetup(index).type() for index, field in fields},
        "map_tips": tips,
        "pixels": pixels,
        "errors": errors,
    }


def main(arguments: list[str]) -> int:
    """Describe every FILE LAYER OUT.png on the command line."""
    QgsApplication.setPrefixPath("/usr", True)
    application = QgsApplication([], False)
    application.initQgis()
    triples = zip(arguments[::3], arguments[1::3], arguments[2::3], strict=True)
    found = [describe(*triple) for triple in triples]
    print(json.dumps(found))  # noqa: T201 - a script: its output is read by the test
    QgsProject.instance().removeAllMapLayers()
    application.exitQgis()
    return 0 if all(layer["valid"] for layer in found) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
