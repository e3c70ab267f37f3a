"""Tracks of feet and faces → CVAT XML 1.1, as CVAT exports a video task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

LABEL = "skilt"
"""The one label of the task; what stands on the pole is in the attribute ``skiltnummer``."""
CORNER_PX = 0.5
"""CVAT counts from the corner of the first pixel, this project from its centre."""
_FOOT_NUMBERS = 2
_ATTRIBUTES = ("skiltnummer", "object")


class CvatRow(NamedTuple):
    """One picture of a track.

    Attributes
    ----------
    frame : int
    place_px : (x, y) or (left, top, right, bottom)
        A foot, or a box; (0, 0) is the centre of the first pixel.
    is_key : bool
        Whether somebody put it there. What CVAT itself writes between two such rows has ``keyframe="0"``.
    """

    frame: int
    place_px: tuple[float, ...]
    is_key: bool = True


@dataclass(frozen=True, slots=True)
class CvatTrack:
    """One object: rows in the order of their frames, all of one kind."""

    rows: Sequence[CvatRow]
    attributes: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class CvatTask:
    """What the file says of the recording.

    Attributes
    ----------
    last_frame : int
    step : int
        Every so many frames were looked at.
    owner : str
        Who annotated; "" where that is not said.
    has_gaps : bool
        Whether a track that lacks a frame was out of view there; otherwise nobody looked.
    """

    name: str
    source: str
    width_px: int
    height_px: int
    last_frame: int
    made: datetime
    step: int = 1
    owner: str = ""
    has_gaps: bool = False


def cvat_document(task: CvatTask, tracks: Sequence[CvatTrack]) -> str:
    """Return the annotations of one camera.

    A track ends with ``outside="1"``, so that CVAT does not carry it on to the end of the video. Track ids
    count from 0 in every task: the attribute ``object`` says which physical pole it is, in all cameras.
    """
    has_boxes = any(len(row.place_px) != _FOOT_NUMBERS for track in tracks for row in track.rows)
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<annotations>", "  <version>1.1</version>"]
    lines += _meta(task, "any" if has_boxes else "points")
    for number, track in enumerate(tracks):
        lines += _track(task, number, track)
    lines.append("</annotations>")
    return "\n".join(lines) + "\n"


def _meta(task: CvatTask, shapes: str) -> list[str]:
    made = task.made.isoformat(sep=" ")
    attributes = "".join(
        f"<attribute><name>{name}</name><mutable>False</mutable><input_type>text</input_type>"
        "<default_value></default_value><values></values></attribute>"
        for name in _ATTRIBUTES
    )
    owner = [f"      <owner><username>{escape(task.owner)}</username></owner>"] if task.owner else []
    return [
        "  <meta>",
        "    <task>",
        "      <id>1</id>",
        f"      <name>{escape(task.name)}</name>",
        f"      <size>{task.last_frame // task.step + 1}</size>",
        "      <mode>interpolation</mode>",
        *owner,
        f"      <created>{made}</created>",
        f"      <updated>{made}</updated>",
        "      <start_frame>0</start_frame>",
        f"      <stop_frame>{task.last_frame}</stop_frame>",
        f"      <frame_filter>step={task.step}</frame_filter>",
        f"      <labels><label><name>{LABEL}</name><type>{shapes}</type>",
        f"        <attributes>{attributes}</attributes></label></labels>",
        "      <original_size>",
        f"        <width>{task.width_px}</width>",
        f"        <height>{task.height_px}</height>",
        "      </original_size>",
        "    </task>",
        f"    <dumped>{made}</dumped>",
        f"    <source>{escape(task.source)}</source>",
        "  </meta>",
    ]


def _track(task: CvatTask, number: int, track: CvatTrack) -> list[str]:
    attributes = [
        f"      <attribute name={quoteattr(name)}>{escape(value)}</attribute>"
        for name, value in track.attributes.items()
    ]
    lines, rows = [f'  <track id="{number}" label="{LABEL}" source="manual">'], track.rows
    for i, row in enumerate(rows):
        lines += _row(row, attributes, outside=False)
        after = row.frame + task.step
        lost = i + 1 == len(rows) or (task.has_gaps and rows[i + 1].frame > after)
        if lost and after <= task.last_frame:
            lines += _row(CvatRow(after, row.place_px), attributes, outside=True)
    lines.append("  </track>")
    return lines


def _row(row: CvatRow, attributes: Sequence[str], *, outside: bool) -> list[str]:
    numbers = [f"{value + CORNER_PX:.2f}" for value in row.place_px]
    state = f'outside="{outside:d}" occluded="0" keyframe="{row.is_key:d}"'
    if len(numbers) == _FOOT_NUMBERS:
        tag, place = "points", f'points="{",".join(numbers)}"'
    else:
        edges = zip(("xtl", "ytl", "xbr", "ybr"), numbers, strict=True)
        tag, place = "box", " ".join(f'{edge}="{value}"' for edge, value in edges)
    return [f'    <{tag} frame="{row.frame}" {state} {place} z_order="0">', *attributes, f"    </{tag}>"]
