"""The default QGIS style of each exported layer."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from twin.export.appearance import (
    DECISION_LABELS,
    DRIVE_COLOUR,
    ESTIMATE_COLOUR,
    MARKS,
    NVDB_COLOUR,
    OTHER_COLOUR,
    Mark,
)
from twin.export.layers import COLUMNS
from twin.export.qgis import qml
from twin.export.qgis.map_tips import map_tip

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element


REQUIRED_M = 1.0
"""NVDB's own requirement for sign positions since 2015."""

_TYPES = {"95": "Skiltpunkt", "96": "Skiltplate"}
_RANKS = " ".join(f"WHEN '{mark.verdict}' THEN {number}" for number, mark in enumerate(MARKS))
# What a person decides, then why; at the end the change's id, and where it comes from.
_FORM = (
    "decision",
    "verdict",
    "reason",
    "confidence",
    "skiltnummer_nvdb",
    "skiltnummer_seen",
    "distance_m",
    "distance_sigma_m",
    "nvdb_type",
    "nvdb_id",
    "nvdb_version",
    "n_sightings",
    "drive_ids",
    "change_id",
    "cameras",
    "synced_at",
    "software",
    "config_sha256",
)
# What matters most is drawn last.
_ORDER = f'CASE "verdict" {_RANKS} ELSE {len(MARKS)} END'
# A mark is from 0.8 to 1.2 times the verdict's size, by its confidence.
_SURER = '0.8 + 0.4 * coalesce("confidence", 0.5)'


def style(layer: str, *, verdicts: Collection[str]) -> str:
    """QML document of a layer.

    Parameters
    ----------
    layer : str
        A key of :data:`twin.export.layers.COLUMNS`.
    verdicts : collection of str
        The verdicts that occur in the layer: the legends of ``changes`` and ``moves`` show these, or all
        where there is none.
    """
    occurring = [mark for mark in MARKS if mark.verdict in verdicts] or MARKS
    if layer == "changes":
        return _changes(occurring)
    if layer == "moves":
        return _moves(occurring)
    return {"nvdb_signs": _nvdb_signs, "estimates": _estimates, "ellipses": _ellipses, "drives": _drives}[
        layer
    ]()


def _changes(occurring: Sequence[Mark]) -> str:
    shown = [(mark.verdict, mark.label, _verdict_symbol(mark)) for mark in reversed(occurring)]
    other = qml.simple_marker(
        "circle", qml.rgba("#ffffff"), 3.0, outline_color=qml.rgba(OTHER_COLOUR), outline_width="0.4"
    )
    codes = (
        "replace(CASE WHEN \"verdict\" IN ('unchanged', 'not_observable') THEN '' "
        'WHEN "verdict" = \'wrong_type\' THEN "skiltnummer_nvdb" || \' → \' || "skiltnummer_seen" '
        "WHEN \"skiltnummer_seen\" <> '' THEN \"skiltnummer_seen\" ELSE \"skiltnummer_nvdb\" END, ';', ' + ')"
    )
    return qml.document(
        qml.categorised_renderer("verdict", [*shown, ("", "Other", qml.symbol("marker", [other]))], _ORDER),
        aliases=_aliases("changes"),
        editable=frozenset({"decision"}),
        widgets={
            "verdict": qml.value_map({mark.verdict: mark.label for mark in MARKS}),
            "nvdb_type": qml.value_map(_TYPES),
            "decision": qml.value_map(DECISION_LABELS),
            "reason": qml.text_box(),
            "confidence": qml.rounded(2),
            "distance_m": qml.rounded(2),
            "distance_sigma_m": qml.rounded(2),
        },
        form=_FORM,
        display='"verdict" || \' \' || "skiltnummer_nvdb" || \' \' || "skiltnummer_seen"',
        map_tip=map_tip("changes"),
        labels=qml.simple_labels(codes, colour="#222222", size_pt=8.0, from_scale=5000),
    )


def _moves(occurring: Sequence[Mark]) -> str:
    shown = [
        (
            mark.verdict,
            mark.label,
            qml.symbol("line", [qml.simple_line(qml.rgba(mark.colour), 0.2 * mark.size_mm)]),
        )
        for mark in reversed(occurring)
    ]
    return qml.document(
        qml.categorised_renderer("verdict", shown, _ORDER),
        aliases=_aliases("moves"),
        editable=frozenset(),
        widgets={"verdict": qml.value_map({mark.verdict: mark.label for mark in MARKS})},
        display='"verdict" || \' \' || "change_id"',
        map_tip=map_tip("moves"),
    )


def _estimates() -> str:
    rim = qml.rgba(ESTIMATE_COLOUR)
    dot = qml.simple_marker("circle", rim, 1.4, outline_width="0.15")
    ring = qml.simple_marker(
        "circle", qml.rgba(ESTIMATE_COLOUR, 0.0), 1.8, outline_color=rim, outline_width="0.4"
    )
    shown = [
        ("plain", "Without flags", qml.symbol("marker", [dot])),
        ("flagged", "With flags", qml.symbol("marker", [ring])),
    ]
    return qml.document(
        qml.categorised_renderer("CASE WHEN \"flags\" <> '' THEN 'flagged' ELSE 'plain' END", shown),
        aliases=_aliases("estimates"),
        editable=frozenset(),
        widgets={},
        display='"object" || \' \' || "skiltnummer"',
        map_tip=map_tip("estimates"),
    )


def _ellipses() -> str:
    inside, rim = qml.rgba(ESTIMATE_COLOUR, 0.15), qml.rgba(ESTIMATE_COLOUR)
    shown = [
        (
            value,
            f"CEP95 {words} {REQUIRED_M:g} m",
            qml.symbol("fill", [qml.simple_fill(inside, rim, 0.3, outline)]),
        )
        for value, words, outline in (("within", "up to", "solid"), ("wide", "over", "dash"))
    ]
    return qml.document(
        qml.categorised_renderer(f"if(\"cep95_m\" > {REQUIRED_M:g}, 'wide', 'within')", shown),
        aliases=_aliases("ellipses"),
        editable=frozenset(),
        widgets={},
        display='"object"',
        map_tip=map_tip("ellipses"),
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
    shown = [
        (value, label, qml.symbol("line", [qml.simple_line(qml.rgba(DRIVE_COLOUR), 0.6, pattern)]))
        for value, label, pattern in (
            ("complete", "Every sign in view annotated", "solid"),
            ("partial", "Not every sign in view annotated", "dash"),
        )
    ]
    return qml.document(
        qml.categorised_renderer("if(\"annotations_complete\", 'complete', 'partial')", shown),
        aliases=_aliases("drives"),
        editable=frozenset(),
        widgets={},
        display='"name"',
        map_tip=map_tip("drives"),
    )


def _aliases(layer: str) -> dict[str, str]:
    return {column.name: column.label for column in COLUMNS[layer]}


def _verdict_symbol(mark: Mark) -> Element:
    marker = qml.simple_marker(
        mark.marker, qml.rgba(mark.colour), mark.size_mm, _SURER, angle=f"{mark.angle_deg:g}"
    )
    return qml.symbol("marker", [marker])
