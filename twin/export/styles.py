"""The default QGIS style of each exported layer."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from twin.export import qml
from twin.export.layers import COLUMNS, EPSG_UTM33
from twin.export.map_tips import map_tip
from twin.export.verdicts import (
    DECISIONS,
    DRIVE_COLOUR,
    ESTIMATE_COLOUR,
    NVDB_COLOUR,
    OTHER_COLOUR,
    VERDICTS,
    Verdict,
)

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

SIGMAS_95 = 2.4477468306808166
"""Half axis of the 95 % ellipse of a two-dimensional Gaussian, in sigmas: sqrt(-2 ln 0.05)."""

# Grid convergence of UTM zone 33 to the first order: tan γ = tan(λ - 15°) sin φ. Better than 0.01° in Norway.
_CONVERGENCE = (
    f"with_variable('p', transform($geometry, 'EPSG:{EPSG_UTM33}', 'EPSG:4326'), "
    "degrees(atan(tan(radians(x(@p) - 15)) * sin(radians(y(@p))))))"
)
_TYPES = {"95": "Skiltpunkt", "96": "Skiltplate"}


def style(layer: str, *, epsg: int, verdicts: Collection[str]) -> str:
    """QML document of a layer.

    Parameters
    ----------
    layer : str
        A key of :data:`twin.export.layers.COLUMNS`.
    epsg : int
        CRS of the file: error ellipses turn with the map's north.
    verdicts : collection of str
        The verdicts that occur: the legend of ``changes`` shows these, or all where there is none.
    """
    if layer == "changes":
        return _changes([verdict for verdict in VERDICTS if verdict.name in verdicts] or VERDICTS)
    if layer == "estimates":
        return _estimates(epsg)
    return _nvdb_signs() if layer == "nvdb_signs" else _drives()


def _changes(occurring: Sequence[Verdict]) -> str:
    rank = " ".join(f"WHEN '{verdict.name}' THEN {number}" for number, verdict in enumerate(VERDICTS))
    order = f'CASE "verdict" {rank} ELSE {len(VERDICTS)} END'
    shown = [(verdict.name, verdict.label, _verdict_symbol(verdict)) for verdict in reversed(occurring)]
    other = qml.simple_marker(
        "circle", qml.rgba("#ffffff"), 3.0, outline_color=qml.rgba(OTHER_COLOUR), outline_width="0.4"
    )
    codes = (
        "replace(CASE WHEN \"verdict\" IN ('unchanged', 'not_observable') THEN '' "
        'WHEN "verdict" = \'wrong_type\' THEN "skiltnummer_nvdb" || \' → \' || "skiltnummer_seen" '
        "WHEN \"skiltnummer_seen\" <> '' THEN \"skiltnummer_seen\" ELSE \"skiltnummer_nvdb\" END, ';', ' + ')"
    )
    return qml.document(
        qml.categorised_renderer("verdict", [*shown, ("", "Other", qml.symbol("marker", [other]))], order),
        aliases=_aliases("changes"),
        editable=frozenset({"decision"}),
        widgets={
            "verdict": qml.value_map({verdict.name: verdict.label for verdict in VERDICTS}),
            "nvdb_type": qml.value_map(_TYPES),
            "decision": qml.value_map(DECISIONS),
        },
        display='"verdict" || \' \' || "skiltnummer_nvdb" || \' \' || "skiltnummer_seen"',
        map_tip=map_tip("changes"),
        labels=qml.simple_labels(codes, colour="#222222", size_pt=8.0, from_scale=5000),
    )


def _estimates(epsg: int) -> str:
    turned = f'"sigma_azimuth_deg" - {_CONVERGENCE}' if epsg == EPSG_UTM33 else '"sigma_azimuth_deg"'
    ellipse = qml.symbol_layer(
        "EllipseMarker",
        {
            "symbol_name": "circle",
            "symbol_width": "0",
            "symbol_width_unit": qml.METRES,
            "symbol_height": "0",
            "symbol_height_unit": qml.METRES,
            "color": qml.rgba(ESTIMATE_COLOUR, 0.15),
            "outline_color": qml.rgba(ESTIMATE_COLOUR, 0.8),
            "outline_width": "0.3",
            "outline_width_unit": "MM",
        },
        {
            "width": f'{2 * SIGMAS_95:.6f} * "sigma_minor_m"',
            "height": f'{2 * SIGMAS_95:.6f} * "sigma_major_m"',
            "angle": turned,
        },
    )
    dot = qml.simple_marker("circle", qml.rgba(ESTIMATE_COLOUR), 1.4, outline_width="0.15")
    return qml.document(
        qml.single_renderer(qml.symbol("marker", [ellipse, dot])),
        aliases=_aliases("estimates"),
        editable=frozenset(),
        widgets={},
        display='"object" || \' \' || "skiltnummer"',
        map_tip=map_tip("estimates"),
    )


def _nvdb_signs() -> str:
    kinds = (
        ("96", "Skiltplate", "circle", 3.4, "0.5"),
        ("95", "Skiltpunkt", "square", 2.6, "0.5"),
        ("road", "On the road's line: no geometry of its own", "diamond", 2.6, "0.25"),
    )
    kind = 'CASE WHEN "own_geometry" THEN to_string("nvdb_type") ELSE \'road\' END'
    hollow = qml.rgba(NVDB_COLOUR, 0.0)
    rim = qml.rgba(NVDB_COLOUR)
    shown = [
        (
            value,
            label,
            qml.symbol(
                "marker", [qml.simple_marker(shape, hollow, size, outline_color=rim, outline_width=width)]
            ),
        )
        for value, label, shape, size, width in kinds
    ]
    return qml.document(
        qml.categorised_renderer(kind, shown),
        aliases=_aliases("nvdb_signs"),
        editable=frozenset(),
        widgets={"nvdb_type": qml.value_map(_TYPES)},
        display='"nvdb_id" || \' \' || "skiltnummer"',
        map_tip=map_tip("nvdb_signs"),
    )


def _drives() -> str:
    return qml.document(
        qml.single_renderer(qml.symbol("line", [qml.simple_line(qml.rgba(DRIVE_COLOUR), 0.6)])),
        aliases=_aliases("drives"),
        editable=frozenset(),
        widgets={},
        display='"name"',
        map_tip=map_tip("drives"),
    )


def _aliases(layer: str) -> dict[str, str]:
    return {column.name: column.label for column in COLUMNS[layer]}


def _verdict_symbol(verdict: Verdict) -> Element:
    marker = qml.simple_marker(
        verdict.marker, qml.rgba(verdict.colour), verdict.size_mm, angle=f"{verdict.angle_deg:g}"
    )
    return qml.symbol("marker", [marker])
