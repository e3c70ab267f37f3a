"""A QGIS project in the GeoPackage: the layers grouped, in order and in colour, zoomed to what is to decide.

QGIS keeps a project as a row of the table ``qgis_projects``: a name, a little JSON, and the hexadecimal text
of a zip with one ``.qgs`` document. The document holds what QGIS 3.22 itself writes there, less all that
equals its defaults. Nothing in it comes from the clock or from chance. The base map is the only layer that
needs the network: it is off, and asks for nothing until a person ticks it.

Sources: QGIS 3.22, *Project ▸ Save To ▸ GeoPackage*; https://docs.qgis.org/3.22 (*QGS/QGZ file format*).
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING
from urllib.parse import quote
from xml.etree import ElementTree as ET

from twin.export.layers import EPSG_UTM33, EPSG_WGS84, GEOMETRY, description
from twin.export.qgis.qml import DOCTYPE, style
from twin.store.kinds import QUIET, Decision
from twin.web.base_map import CREDIT, TILES
from twin.words import Lang, say

if TYPE_CHECKING:
    import geopandas as gpd

PROJECT = "twin"
"""Name of the project in the file."""

GROUPS: dict[str, tuple[str, ...]] = {
    "to_decide": ("to_decide", "moves_to_decide"),
    "findings": ("changes", "moves"),
    "belief": ("belief", "roads_to_drive"),
    "nvdb": ("nvdb_signs",),
    "measured": ("estimates", "ellipses"),
    "drives": ("drives",),
    "background": ("base_map",),
}
"""Group of the layer panel → its layers; the first of all lies on top of the map."""

_QUIET = ", ".join(f"'{verdict}'" for verdict in sorted(QUIET))
_WAITS = f"coalesce(\"decision\", '{Decision.OPEN}') = '{Decision.OPEN}' AND \"verdict\" NOT IN ({_QUIET})"
FILTERED: dict[str, tuple[str, str]] = {
    "to_decide": ("changes", _WAITS),
    "moves_to_decide": (
        "moves",
        f'"change_id" IN (SELECT "change_id" FROM "changes" WHERE {_WAITS})',  # noqa: S608 - our own names
    ),
}
"""Layer of the project that shows a part of a layer of the file → that layer, and which rows."""

THEMES: dict[str, frozenset[str]] = {
    "to_decide": frozenset(("to_decide", "moves_to_decide", "nvdb_signs", "ellipses", "drives")),
    "all": frozenset(("changes", "moves", "nvdb_signs", "estimates", "ellipses", "drives")),
    "belief": frozenset(("belief", "roads_to_drive", "drives")),
}
"""Map theme → the layers that it shows. The project opens with the first, or if nobody waits, the second."""

BASE_MAP = f"type=xyz&url={quote(TILES, safe=':/')}&zmax=18&zmin=0"
"""Kartverket's topographic map in grey, as QGIS writes the address of tiles."""

# As QGIS 3.22 itself makes it.
PROJECTS_TABLE = "CREATE TABLE qgis_projects(name TEXT PRIMARY KEY, metadata BLOB, content BLOB)"

_QGIS_GEOMETRY = {"Point": "Point", "LineString": "Line", "Polygon": "Polygon"}
_EPSG_TILES = 3857
_QGIS_SRSID = {EPSG_UTM33: 2106, EPSG_WGS84: 3452, _EPSG_TILES: 3857}
_SCALE_RANGE = ("hasScaleBasedVisibilityFlag", "minScale", "maxScale")
_EARLIEST = (1980, 1, 1, 0, 0, 0)
"""The oldest moment that a zip can hold, in place of the clock's."""
_UNIX = 3
_MARGIN = 0.1
_LEAST_HALF_WIDTH = {EPSG_UTM33: 25.0, EPSG_WGS84: 25.0 / 111_000}
"""Metres and degrees: how far to each side a project shows at least, by EPSG code."""


def project_row(
    layers: Mapping[str, gpd.GeoDataFrame],
    styles: Mapping[str, str],
    file: str,
    time: str,
    lang: Lang = Lang.EN,
) -> tuple[str, str, str]:
    """Make the row of ``qgis_projects``: name, metadata, content.

    Parameters
    ----------
    layers : mapping
        Every layer of the file, all in one CRS.
    styles : mapping
        Layer → QML document.
    file : str
        Name of the GeoPackage; the project finds it beside itself, wherever it is.
    time : str
        ISO 8601 in UTC; QGIS shows it as the time of the last change.
    lang : Lang, optional
        Of the names of layers, groups and themes.
    """
    packed, entry = io.BytesIO(), zipfile.ZipInfo(f"{PROJECT}.qgs", _EARLIEST)
    # The same on every system; and stored, since versions of zlib differ in the bytes that they give.
    entry.create_system = _UNIX
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(entry, document(layers, styles, file, lang))
    metadata = json.dumps({"last_modified_time": time[:19], "last_modified_user": ""})
    return PROJECT, metadata, packed.getvalue().hex()


def document(
    layers: Mapping[str, gpd.GeoDataFrame], styles: Mapping[str, str], file: str, lang: Lang = Lang.EN
) -> str:
    """Write the project as QGIS's XML; parameters as in :func:`project_row`."""
    epsg = next(iter(layers.values())).crs.to_epsg()
    waiting = _waiting(layers["changes"])
    root = ET.Element("qgis", {"version": "3.22.0", "projectname": PROJECT})
    ET.SubElement(root, "title").text = say(lang, "qgis.title")
    ET.SubElement(root, "projectCrs").append(_crs(epsg))
    root.append(_layer_tree(file, THEMES["to_decide" if len(waiting) else "all"], lang))
    _add_views(root, _extent({"waiting": waiting, **layers}, epsg), epsg)
    maps = ET.SubElement(root, "projectlayers")
    order = ET.SubElement(root, "layerorder")
    # The legend of what is to decide has no verdicts that ask nobody.
    queue = {
        table: style(table, verdicts=set(waiting["verdict"]), lang=lang) for table, _ in FILTERED.values()
    }
    for name in _names():
        if name == "base_map":
            maps.append(_base_map(lang))
        else:
            table = FILTERED.get(name, (name, ""))[0]
            qml = queue[table] if name in FILTERED else styles[table]
            maps.append(_map_layer(name, table, file, qml, epsg, lang))
        ET.SubElement(order, "layer", {"id": _id(name)})
    _add_themes(root, lang)
    _add_properties(root, epsg)
    return f"{DOCTYPE}\n{ET.tostring(root, encoding='unicode')}\n"


def _waiting(changes: gpd.GeoDataFrame) -> gpd.GeoDataFrame:
    """The findings that wait for somebody to decide."""
    return changes[(changes["decision"] == Decision.OPEN) & ~changes["verdict"].isin(list(QUIET))]


def _names() -> list[str]:
    return [name for names in GROUPS.values() for name in names]


def _id(name: str) -> str:
    # QGIS replaces an id of ten letters or fewer by one of its own.
    return f"twin_layer_{name}"


def _title(name: str, lang: Lang) -> str:
    return say(lang, "qgis.base_map" if name == "base_map" else f"qgis.layer.{name}")


def _source(name: str, file: str) -> str:
    if name == "base_map":
        return BASE_MAP
    table, part = FILTERED.get(name, (name, ""))
    return f"./{file}|layername={table}" + (f"|subset={part}" if part else "")


def _crs(epsg: int) -> ET.Element:
    """Name a CRS by its code; QGIS looks the rest up, as long as there is a number of its own beside it."""
    crs = ET.Element("spatialrefsys")
    ET.SubElement(crs, "srsid").text = str(_QGIS_SRSID[epsg])
    ET.SubElement(crs, "authid").text = f"EPSG:{epsg}"
    return crs


def _layer_tree(file: str, shown: Collection[str], lang: Lang) -> ET.Element:
    tree = ET.Element("layer-tree-group")
    for group, names in GROUPS.items():
        branch = ET.SubElement(
            tree,
            "layer-tree-group",
            {"name": say(lang, f"qgis.group.{group}"), "expanded": "1", "checked": "Qt::Checked"},
        )
        for name in names:
            ET.SubElement(
                branch,
                "layer-tree-layer",
                {
                    "id": _id(name),
                    "name": _title(name, lang),
                    "source": _source(name, file),
                    "providerKey": "wms" if name == "base_map" else "ogr",
                    "checked": "Qt::Checked" if name in shown else "Qt::Unchecked",
                    # The legend of the findings is what a person looks for; the others open by a click.
                    "expanded": "1" if name in shown and name in {"to_decide", "changes"} else "0",
                },
            )
    return tree


def _map_layer(name: str, table: str, file: str, document: str, epsg: int, lang: Lang) -> ET.Element:
    """Make a layer with its style, whose document has the same elements as a layer of a project."""
    from defusedxml.ElementTree import fromstring

    qml = fromstring(document)
    layer = ET.Element(
        "maplayer",
        {
            "type": "vector",
            "geometry": _QGIS_GEOMETRY[GEOMETRY[table]],
            "wkbType": GEOMETRY[table],
            "labelsEnabled": qml.get("labelsEnabled", "0"),
            "styleCategories": "AllStyleCategories",
            **{key: value for key, value in qml.attrib.items() if key in _SCALE_RANGE},
        },
    )
    ET.SubElement(layer, "id").text = _id(name)
    ET.SubElement(layer, "datasource").text = _source(name, file)
    ET.SubElement(layer, "layername").text = _title(name, lang)
    ET.SubElement(layer, "abstract").text = description(table)
    ET.SubElement(layer, "srs").append(_crs(epsg))
    ET.SubElement(layer, "provider", {"encoding": "UTF-8"}).text = "ogr"
    layer.extend(list(qml))
    return layer


def _base_map(lang: Lang) -> ET.Element:
    """Make the layer of Kartverket's tiles."""
    layer = ET.Element("maplayer", {"type": "raster"})
    ET.SubElement(layer, "id").text = _id("base_map")
    ET.SubElement(layer, "datasource").text = BASE_MAP
    ET.SubElement(layer, "layername").text = _title("base_map", lang)
    ET.SubElement(layer, "srs").append(_crs(_EPSG_TILES))
    rights = ET.SubElement(layer, "resourceMetadata")
    ET.SubElement(rights, "rights").text = CREDIT
    ET.SubElement(layer, "provider").text = "wms"
    pipe = ET.SubElement(layer, "pipe")
    ET.SubElement(pipe, "rasterrenderer", {"type": "singlebandcolordata", "band": "1", "opacity": "1"})
    return layer


def _add_themes(root: ET.Element, lang: Lang) -> None:
    """Add the map themes: which layers are on; what is folded in the panel stays as a person has it."""
    themes = ET.SubElement(root, "visibility-presets")
    for theme, shown in THEMES.items():
        one = ET.SubElement(themes, "visibility-preset", {"name": say(lang, f"qgis.theme.{theme}")})
        for name in _names():
            if name in shown:
                ET.SubElement(one, "layer", {"id": _id(name), "visible": "1", "style": "default"})


def _extent(layers: Mapping[str, gpd.GeoDataFrame], epsg: int) -> tuple[float, float, float, float] | None:
    """Find west, south, east and north of what waits, with a margin; else of the next layer that has any."""
    import numpy as np

    for name in ("waiting", "changes", "estimates", "drives", "nvdb_signs"):
        west, south, east, north = (float(bound) for bound in layers[name].total_bounds)
        if np.isfinite([west, south, east, north]).all():
            margin = _MARGIN * max(east - west, north - south)
            least = _LEAST_HALF_WIDTH[epsg]
            wide, high = (
                max((high - low) / 2 + margin, least) for low, high in ((west, east), (south, north))
            )
            x, y = (west + east) / 2, (south + north) / 2
            return x - wide, y - high, x + wide, y + high
    return None


def _add_views(root: ET.Element, extent: Sequence[float] | None, epsg: int) -> None:
    """Zoom the main map, and say where *Zoom to the project's extent* leads (QGIS 3.22 and later)."""
    if extent is None:
        return
    digits = 8 if epsg == EPSG_WGS84 else 3
    sides = {
        name: f"{side:.{digits}f}"
        for name, side in zip(("xmin", "ymin", "xmax", "ymax"), extent, strict=True)
    }
    canvas = ET.SubElement(root, "mapcanvas", {"name": "theMapCanvas", "annotationsVisible": "1"})
    ET.SubElement(canvas, "units").text = "degrees" if epsg == EPSG_WGS84 else "meters"
    box = ET.SubElement(canvas, "extent")
    for side, value in sides.items():
        ET.SubElement(box, side).text = value
    ET.SubElement(canvas, "rotation").text = "0"
    ET.SubElement(canvas, "destinationsrs").append(_crs(epsg))
    view = ET.SubElement(root, "ProjectViewSettings", {"UseProjectScales": "0", "rotation": "0"})
    ET.SubElement(view, "Scales")
    ET.SubElement(view, "DefaultViewExtent", sides).append(_crs(epsg))


def _add_properties(root: ET.Element, epsg: int) -> None:
    """Relative paths, so that the file can be moved; and the map projected into the project's CRS."""
    properties = ET.SubElement(root, "properties")
    paths = ET.SubElement(properties, "Paths")
    ET.SubElement(paths, "Absolute", {"type": "bool"}).text = "false"
    reference = ET.SubElement(properties, "SpatialRefSys")
    ET.SubElement(reference, "ProjectionsEnabled", {"type": "int"}).text = "1"
    if epsg != EPSG_WGS84:
        measurement = ET.SubElement(properties, "Measurement")
        ET.SubElement(measurement, "DistanceUnits", {"type": "QString"}).text = "meters"
        ET.SubElement(measurement, "AreaUnits", {"type": "QString"}).text = "m2"
