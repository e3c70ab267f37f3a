"""Open the project in a GeoPackage in QGIS without a screen, and tell what a user would find.

Run by the system's Python, which has QGIS's bindings::

    /usr/bin/python3 tests/qgis_open_project.py URI

Prints one JSON object. It also takes a decision in the form of ``changes`` and saves it.
"""

from __future__ import annotations

import json
import os
import sys
from typing import Any

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from qgis.core import QgsApplication, QgsMapLayer, QgsProject
from qgis.gui import QgsAttributeEditorContext, QgsAttributeForm, QgsGui


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
        "aliases": {field.name(): field.alias() for field in layer.fields()},
        "editable": [field.name() for i, field in enumerate(layer.fields()) if not form.readOnly(i)],
        "map_tip": bool(layer.mapTipTemplate()),
        "labels": layer.labelsEnabled(),
    }


def decide(layer: QgsMapLayer, decision: str) -> dict[str, Any]:
    """Take a decision about the first finding in its form, and save it; return what the file holds then."""
    QgsGui.editorWidgetRegistry().initEditors()
    layer.startEditing()
    feature = next(layer.getFeatures())
    before = feature.attributes()
    form = QgsAttributeForm(layer, feature)
    form.setMode(QgsAttributeEditorContext.SingleEditMode)
    form.changeAttribute("decision", decision)
    saved = form.save() and layer.commitChanges()
    after = layer.getFeature(feature.id()).attributes()
    names = [field.name() for field in layer.fields()]
    changed = {name: new for name, old, new in zip(names, before, after, strict=True) if old != new}
    shown = [element.name() for element in layer.editFormConfig().tabs()]
    return {"saved": saved, "change_id": feature["change_id"], "changed": changed, "form": shown}


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
    found = {
        "read": read,
        "error": project.error(),
        "crs": project.crs().authid(),
        "names": project.projectStorage().listProjects(uri) if read else [],
        "order": [layer.name() for layer in root.layerOrder()],
        "groups": {
            group.name(): [describe(node.layer()) for node in group.findLayers()] for group in root.children()
        },
        "view": [view.xMinimum(), view.yMinimum(), view.xMaximum(), view.yMaximum()],
    }
    if read:
        found["decided"] = decide(project.mapLayersByName("changes")[0], "accept")
    sys.stdout.write(json.dumps(found))
    sys.stdout.flush()
    # Without the clean-up of QGIS's widgets, which crashes under Python.
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1])
