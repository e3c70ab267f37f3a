"""Open the live layers in QGIS without a screen, tell what a user would see, and decide in one of them.

Run by the system's Python, which has QGIS's bindings::

    /usr/bin/python3 tests/qgis_live_layers.py HOST DATABASE LOGIN CHANGE_ID

Prints one JSON object. The layers are found as QGIS's browser finds them: keys, types, CRS and styles are the
database's own.
"""

from __future__ import annotations

import json
import os
import sys
from typing import Any

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from qgis.core import (
    QgsApplication,
    QgsDataSourceUri,
    QgsExpression,
    QgsExpressionContext,
    QgsExpressionContextUtils,
    QgsProviderRegistry,
    QgsVectorLayer,
    QgsWkbTypes,
)


def opened(uri: str, name: str) -> tuple[QgsVectorLayer, dict[str, Any]]:
    """Open one layer, and tell what QGIS makes of it."""
    layer = QgsVectorLayer(uri, name, "postgres")
    form, fields = layer.editFormConfig(), list(enumerate(layer.fields()))
    tips = []
    for feature in layer.getFeatures():
        context = QgsExpressionContext(QgsExpressionContextUtils.globalProjectLayerScopes(layer))
        context.setFeature(feature)
        tips.append(QgsExpression.replaceExpressionText(layer.mapTipTemplate(), context))
    return layer, {
        "valid": layer.isValid(),
        "features": layer.featureCount(),
        "crs": layer.crs().authid(),
        "type": QgsWkbTypes.displayString(layer.wkbType()),
        "renderer": layer.renderer().type(),
        "aliases": {field.name(): field.alias() for _, field in fields},
        "editable": [field.name() for index, field in fields if not form.readOnly(index)],
        "map_tips": tips,
    }


def decided(layer: QgsVectorLayer, change_id: str) -> list[str]:
    """Decide as the form does, and save; return what QGIS says of failures."""
    (feature,) = layer.getFeatures(f"\"change_id\" = '{change_id}'")
    errors = [] if layer.startEditing() else ["cannot be edited"]
    for name, value in (("decision", "accept"), ("comment", "seen in QGIS")):
        layer.changeAttributeValue(feature.id(), layer.fields().indexOf(name), value)
    return errors if layer.commitChanges() else [*errors, *layer.commitErrors()]


def main(host: str, database: str, login: str, change_id: str) -> None:
    """Open every layer of the schema, and decide in ``changes``."""
    QgsApplication.setPrefixPath("/usr", True)
    application = QgsApplication([], False)
    application.initQgis()
    base = QgsDataSourceUri()
    base.setConnection(host, "", database, login, "")
    connection = QgsProviderRegistry.instance().providerMetadata("postgres").createConnection(base.uri(), {})
    told: dict[str, Any] = {}
    layers = {}
    for table in connection.tables("twin_qgis"):
        uri = QgsDataSourceUri(base.uri())
        kind = table.geometryColumnTypes()[0]
        # The browser takes the first column that may be one for the key of a view.
        key = connection.fields("twin_qgis", table.tableName())[0].name()
        uri.setDataSource("twin_qgis", table.tableName(), table.geometryColumn(), "", key)
        uri.setWkbType(kind.wkbType)
        uri.setSrid(kind.crs.authid().partition(":")[2])
        layers[table.tableName()], told[table.tableName()] = opened(uri.uri(False), table.tableName())
    told["errors"] = decided(layers["changes"], change_id)
    print(json.dumps(told))  # noqa: T201 - a script: its output is read by the test
    layers.clear()
    application.exitQgis()


if __name__ == "__main__":
    main(*sys.argv[1:])
