"""Open the project in a GeoPackage in QGIS without a screen, and tell what a user would find.

Run by the system's Python, which has QGIS's bindings::

    /usr/bin/python3 tests/qgis_open_project.py URI

Prints one JSON object. It also answers in the form of what is to decide, and saves that.
"""

from __future__ import annotations

import json
import os
import sys
from typing import Any

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from qgis.core import (
    QgsApplication,
    QgsAttributeEditorElement,
    QgsExpression,
    QgsExpressionContext,
    QgsExpressionContextUtils,
    QgsFeature,
    QgsMapLayer,
    QgsProject,
)
from qgis.gui import QgsAttributeEditorContext, QgsAttributeForm, QgsGui
from qgis.PyQt.QtWidgets import QLabel


def describe(layer: QgsMapLayer) -> dict[str, Any]:
    """Tell what the project makes of one layer."""
    if layer is None or not layer.isValid():
        return {"valid": False}
    form = layer.editFormConfig()
    return {
        "valid": True,
        "name": layer.name(),
        "id": layer.id(),
        "features": layer.featureCount(),
        "crs": layer.crs().authid(),
        "renderer": layer.renderer().type(),
        "legend": [category.label() for category in layer.renderer().categories()],
        "aliases": {field.name(): field.alias() for field in layer.fields()},
        "editable": [field.name() for i, field in enumerate(layer.fields()) if not form.readOnly(i)],
        "map_tip": bool(layer.mapTipTemplate()),
        "labels": layer.labelsEnabled(),
        "table": [column.name for column in layer.attributeTableConfig().columns() if not column.hidden],
    }


def fields_of(element: QgsAttributeEditorElement) -> list[str]:
    """Names of the columns in a box of a form."""
    children = getattr(element, "children", list)()
    return [name for child in children for name in fields_of(child)] if children else [element.name()]


def shown_pictures(form: QgsAttributeForm) -> list[str]:
    """The colour in the middle of each picture in a form."""
    pixmaps = [label.pixmap() for label in form.findChildren(QLabel) if label.pixmap() is not None]
    images = [pixmap.toImage() for pixmap in pixmaps if not pixmap.isNull()]
    return [image.pixelColor(image.width() // 2, image.height() // 2).name() for image in images]


def pictures_of_tip(layer: QgsMapLayer, feature: QgsFeature) -> list[str]:
    """Addresses of the pictures in a map tip."""
    context = QgsExpressionContext(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
    context.setFeature(feature)
    tip = QgsExpression.replaceExpressionText(layer.mapTipTemplate(), context)
    return [part.partition("'")[0] for part in tip.split("src='")[1:]]


def decide(layer: QgsMapLayer, answer: dict[str, str]) -> dict[str, Any]:
    """Answer in the form of the first finding, and save it; return what the file holds then."""
    layer.startEditing()
    n_before = layer.featureCount()
    feature = next(layer.getFeatures())
    before = feature.attributes()
    form = QgsAttributeForm(layer, feature)
    form.setMode(QgsAttributeEditorContext.SingleEditMode)
    form.show()
    QgsApplication.processEvents()
    pictures = shown_pictures(form)
    for column, value in answer.items():
        form.changeAttribute(column, value)
    saved = form.save() and layer.commitChanges()
    # In the layer of all findings: what is decided is not to decide any more.
    after = QgsProject.instance().mapLayer("twin_layer_changes").getFeature(feature.id()).attributes()
    names = [field.name() for field in layer.fields()]
    changed = {name: new for name, old, new in zip(names, before, after, strict=True) if old != new}
    shown = [name for box in layer.editFormConfig().tabs() for name in fields_of(box)]
    return {
        "saved": saved,
        "change_id": feature["change_id"],
        "changed": changed,
        "form": shown,
        "pictures": pictures,
        "tip": pictures_of_tip(layer, feature),
        "before": n_before,
        "left": layer.featureCount(),
    }


def main(uri: str) -> None:
    """Describe the project."""
    QgsApplication.setPrefixPath("/usr", True)
    # Kept until the end: QGIS needs it. With widgets, for the form.
    application = QgsApplication([], True)
    application.initQgis()
    project = QgsProject.instance()
    read = project.read(uri)
    root = project.layerTreeRoot()
    view = project.viewSettings().defaultViewExtent()
    QgsGui.editorWidgetRegistry().initEditors()
    themes = project.mapThemeCollection()
    nodes = root.findLayers()
    base_map = project.mapLayer("twin_layer_base_map")
    found = {
        "read": read,
        "error": project.error(),
        "crs": project.crs().authid(),
        "names": project.projectStorage().listProjects(uri) if read else [],
        "order": [layer.id() for layer in root.layerOrder()],
        "groups": {group.name(): group.findLayerIds() for group in root.children()},
        "layers": [describe(node.layer()) for node in nodes if node.layer() is not base_map],
        "visible": sorted(node.layerId() for node in nodes if node.isVisible()),
        "themes": {name: sorted(themes.mapThemeVisibleLayerIds(name)) for name in themes.mapThemes()},
        "base_map": [base_map.id(), base_map.providerType(), *base_map.metadata().rights()],
        "view": [view.xMinimum(), view.yMinimum(), view.xMaximum(), view.yMaximum()],
    }
    if read:
        layer = project.mapLayer("twin_layer_to_decide")
        found["boxes"] = [box.name() for box in layer.editFormConfig().tabs()]
        answer = {"decision": "accept", "comment": "Står ikke lenger", "author": "kari"}
        found["decided"] = decide(layer, answer)
    sys.stdout.write(json.dumps(found))
    sys.stdout.flush()
    # Without the clean-up of QGIS's widgets, which crashes under Python.
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1])
