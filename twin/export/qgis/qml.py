"""QGIS style documents (QML), piece by piece: what QGIS 3.16 and later read as a layer's default style.

The elements follow what QGIS 3.22 itself writes with *Save Style*; only what differs from QGIS's defaults is
written. Options are written twice, as ``Option`` (QGIS ≥ 3.22) and as ``prop`` (older), as QGIS 3.22 does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from xml.etree import ElementTree as ET

DOCTYPE = "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>"


def rgba(colour: str, alpha: float = 1.0) -> str:
    """Colour ``#rrggbb`` as QGIS writes it: ``r,g,b,a``, each 0–255."""
    channels = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return ",".join(str(channel) for channel in [*channels, round(255 * alpha)])


def symbol_layer(
    kind: str, options: Mapping[str, str], expressions: Mapping[str, str] | None = None
) -> ET.Element:
    """Make one symbol layer.

    Parameters
    ----------
    kind : str
        QGIS's class: ``SimpleMarker``, ``SimpleLine``, ``SimpleFill``.
    options : mapping
        QGIS's option names → values.
    expressions : mapping, optional
        Data-defined properties: QGIS's property name (e.g. ``size``) → expression.
    """
    layer = ET.Element("layer", {"class": kind, "enabled": "1", "locked": "0", "pass": "0"})
    bag = ET.SubElement(layer, "Option", {"type": "Map"})
    for name, value in options.items():
        ET.SubElement(bag, "Option", {"name": name, "type": "QString", "value": value})
    for name, value in options.items():
        ET.SubElement(layer, "prop", {"k": name, "v": value})
    if expressions:
        _data_defined(layer, expressions)
    return layer


def simple_marker(shape: str, colour: str, size_mm: float, scale: str = "", **options: str) -> ET.Element:
    """Make a marker of a size on paper, times the expression `scale`; `options` override QGIS's own."""
    given = {
        "name": shape,
        "color": colour,
        "size": f"{size_mm:g}",
        "size_unit": "MM",
        "outline_color": "255,255,255,255",
        "outline_width": "0.15",
        "outline_width_unit": "MM",
        "joinstyle": "miter",
    }
    sized = {"size": f"{size_mm:g} * ({scale})"} if scale else None
    return symbol_layer("SimpleMarker", given | options, sized)


def simple_line(colour: str, width_mm: float, pattern: str = "solid") -> ET.Element:
    """Make a line of a fixed width on paper, ``solid`` or ``dash``."""
    options = {
        "line_color": colour,
        "line_style": pattern,
        "line_width": f"{width_mm:g}",
        "line_width_unit": "MM",
        "capstyle": "round",
        "joinstyle": "round",
    }
    return symbol_layer("SimpleLine", options)


def simple_fill(colour: str, outline_colour: str, outline_mm: float, pattern: str) -> ET.Element:
    """Make an area with a rim of a fixed width on paper, ``solid`` or ``dash``."""
    options = {
        "color": colour,
        "style": "solid",
        "outline_color": outline_colour,
        "outline_style": pattern,
        "outline_width": f"{outline_mm:g}",
        "outline_width_unit": "MM",
        "joinstyle": "round",
    }
    return symbol_layer("SimpleFill", options)


def symbol(kind: str, layers: Iterable[ET.Element], name: str = "0") -> ET.Element:
    """Make a symbol (`kind` is ``marker``, ``line`` or ``fill``) of symbol layers, the lowest first."""
    element = ET.Element(
        "symbol", {"type": kind, "name": name, "alpha": "1", "clip_to_extent": "1", "force_rhr": "0"}
    )
    element.extend(layers)
    return element


def categorised_renderer(
    expression: str, categories: Sequence[tuple[str, str, ET.Element]], order_by: str = ""
) -> ET.Element:
    """Draw features by the value of an expression.

    Parameters
    ----------
    expression : str
        A field or a QGIS expression.
    categories : sequence of (value, label, symbol)
        The value "" is the fallback for all others.
    order_by : str
        Expression by which features are drawn, the lowest first; "" for none.
    """
    attributes = {"type": "categorizedSymbol", "attr": expression, "symbollevels": "0", "forceraster": "0"}
    renderer = ET.Element("renderer-v2", attributes | {"enableorderby": "1" if order_by else "0"})
    listed = ET.SubElement(renderer, "categories")
    symbols = ET.SubElement(renderer, "symbols")
    for number, (value, label, one) in enumerate(categories):
        ET.SubElement(
            listed, "category", {"symbol": str(number), "value": value, "label": label, "render": "true"}
        )
        one.set("name", str(number))
        symbols.append(one)
    if order_by:
        clauses = ET.SubElement(renderer, "orderby")
        ET.SubElement(clauses, "orderByClause", {"asc": "1", "nullsFirst": "1"}).text = order_by
    return renderer


def simple_labels(expression: str, *, colour: str, size_pt: float, from_scale: int) -> ET.Element:
    """Label features with an expression, on a white halo, from the scale 1 : `from_scale` and closer."""
    labeling = ET.Element("labeling", {"type": "simple"})
    settings = ET.SubElement(labeling, "settings", {"calloutType": "simple"})
    style = ET.SubElement(
        settings,
        "text-style",
        {
            "fieldName": expression,
            "isExpression": "1",
            "fontFamily": "Sans Serif",
            "fontSize": f"{size_pt:g}",
            "fontSizeUnit": "Point",
            "textColor": rgba(colour),
            "textOpacity": "1",
        },
    )
    ET.SubElement(
        style,
        "text-buffer",
        {
            "bufferDraw": "1",
            "bufferSize": "0.8",
            "bufferSizeUnits": "MM",
            "bufferColor": rgba("#ffffff"),
            "bufferOpacity": "1",
        },
    )
    # Placement 6 is "cartographic": beside the point, where there is room.
    ET.SubElement(
        settings,
        "placement",
        {
            "placement": "6",
            "dist": "1.5",
            "distUnits": "MM",
            "offsetType": "1",
            "predefinedPositionOrder": "TR,BR,R,TL,BL,L,TSR,BSR",
        },
    )
    ET.SubElement(
        settings,
        "rendering",
        {"drawLabels": "1", "scaleVisibility": "1", "scaleMax": str(from_scale), "scaleMin": "0"},
    )
    return labeling


def value_map(labels: Mapping[str, str]) -> ET.Element:
    """Edit a field by choosing from value → label."""
    widget = ET.Element("editWidget", {"type": "ValueMap"})
    config = ET.SubElement(ET.SubElement(widget, "config"), "Option", {"type": "Map"})
    entries = ET.SubElement(config, "Option", {"name": "map", "type": "List"})
    for value, label in labels.items():
        entry = ET.SubElement(entries, "Option", {"type": "Map"})
        ET.SubElement(entry, "Option", {"name": label, "type": "QString", "value": value})
    return widget


def text_box() -> ET.Element:
    """Show a long text on several lines."""
    widget = ET.Element("editWidget", {"type": "TextEdit"})
    config = ET.SubElement(ET.SubElement(widget, "config"), "Option", {"type": "Map"})
    ET.SubElement(config, "Option", {"name": "IsMultiline", "type": "bool", "value": "true"})
    return widget


def rounded(digits: int) -> ET.Element:
    """Show a number with so many decimals; null stays empty."""
    widget = ET.Element("editWidget", {"type": "Range"})
    config = ET.SubElement(ET.SubElement(widget, "config"), "Option", {"type": "Map"})
    ET.SubElement(config, "Option", {"name": "AllowNull", "type": "bool", "value": "true"})
    # Without bounds QGIS shows nothing.
    ET.SubElement(config, "Option", {"name": "Min", "type": "double", "value": "0"})
    ET.SubElement(config, "Option", {"name": "Max", "type": "double", "value": "1000000"})
    ET.SubElement(config, "Option", {"name": "Precision", "type": "int", "value": str(digits)})
    ET.SubElement(config, "Option", {"name": "Step", "type": "double", "value": f"{10.0**-digits:g}"})
    ET.SubElement(config, "Option", {"name": "Style", "type": "QString", "value": "SpinBox"})
    return widget


def document(
    renderer: ET.Element,
    *,
    aliases: Mapping[str, str],
    editable: frozenset[str],
    widgets: Mapping[str, ET.Element],
    display: str,
    map_tip: str,
    labels: ET.Element | None = None,
    form: Sequence[str] = (),
) -> str:
    """Put a style together.

    Parameters
    ----------
    renderer : Element
    aliases : mapping
        Field → what a person reads, for every field after ``fid``, in the layer's order.
    editable : frozenset of str
        Fields that a person may edit in the form; all others are read-only.
    widgets : mapping
        Field → its edit widget.
    display : str
        Expression that names a feature in lists.
    map_tip : str
        HTML with ``[% expression %]``.
    labels : Element, optional
    form : sequence of str, optional
        Fields in the order in which the form shows them; that of the layer if empty.

    Returns
    -------
    str
        The QML document.
    """
    categories = "Symbology|Labeling|Fields|Forms|MapTips"
    root = ET.Element(
        "qgis",
        {"version": "3.22.0", "styleCategories": categories, "labelsEnabled": "0" if labels is None else "1"},
    )
    root.append(renderer)
    if labels is not None:
        root.append(labels)
    configuration = ET.SubElement(root, "fieldConfiguration")
    for field, widget in widgets.items():
        ET.SubElement(configuration, "field", {"name": field, "configurationFlags": "None"}).append(widget)
    named = ET.SubElement(root, "aliases")
    # Field 0 is the GeoPackage's fid.
    for index, (field, alias) in enumerate(aliases.items(), start=1):
        ET.SubElement(named, "alias", {"field": field, "index": str(index), "name": alias})
    locks = ET.SubElement(root, "editable")
    for field in ("fid", *aliases):
        ET.SubElement(locks, "field", {"name": field, "editable": "1" if field in editable else "0"})
    if form:
        ET.SubElement(root, "editorlayout").text = "tablayout"
        shown = ET.SubElement(root, "attributeEditorForm")
        at = {field: str(index) for index, field in enumerate(aliases, start=1)}
        for field in form:
            ET.SubElement(
                shown, "attributeEditorField", {"name": field, "index": at[field], "showLabel": "1"}
            )
    ET.SubElement(root, "previewExpression").text = display
    ET.SubElement(root, "mapTip", {"enabled": "1"}).text = map_tip
    return f"{DOCTYPE}\n{ET.tostring(root, encoding='unicode')}\n"


def _data_defined(layer: ET.Element, expressions: Mapping[str, str]) -> None:
    properties = ET.SubElement(
        ET.SubElement(ET.SubElement(layer, "data_defined_properties"), "Option", {"type": "Map"}),
        "Option",
        {"name": "properties", "type": "Map"},
    )
    for name, expression in expressions.items():
        one = ET.SubElement(properties, "Option", {"name": name, "type": "Map"})
        ET.SubElement(one, "Option", {"name": "active", "type": "bool", "value": "true"})
        ET.SubElement(one, "Option", {"name": "expression", "type": "QString", "value": expression})
        # 3: an expression (QgsProperty::ExpressionBasedProperty).
        ET.SubElement(one, "Option", {"name": "type", "type": "int", "value": "3"})
    container = layer.find("data_defined_properties/Option")
    if container is not None:
        ET.SubElement(container, "Option", {"name": "type", "type": "QString", "value": "collection"})
