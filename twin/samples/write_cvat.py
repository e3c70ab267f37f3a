"""Simulated sightings → CVAT XML 1.1, as CVAT exports a video task with point tracks."""

from __future__ import annotations

from datetime import UTC, datetime
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from geoloc.arrays import IntArray
from geoloc.simulation.simulate import SimulatedDrive

LABEL = "skilt"
"""The one label of the task; what stands on the pole is in the attribute ``skiltnummer``."""
CORNER_PX = 0.5
"""CVAT counts from the corner of the first pixel, this project from its centre."""


def cvat_document(drive: SimulatedDrive, camera: str) -> str:
    """Return the annotations of one camera.

    One track an object with one point a key frame, the foot of the pole; a track that loses its object ends
    with ``outside="1"`` and goes on where the object comes back. Track ids count from 0 in every task: the
    attribute ``object`` says which physical pole it is, in all cameras.
    """
    rows = np.flatnonzero(drive.sightings.camera == camera)
    seen = np.unique(drive.sightings.object_index[rows])
    lines = ['<?xml version="1.0" encoding="utf-8"?>', "<annotations>", "  <version>1.1</version>"]
    lines += _meta(drive, camera)
    for track, index in enumerate(seen):
        own = rows[drive.sightings.object_index[rows] == index]
        lines += _track(drive, track, int(index), own[np.argsort(drive.sightings.frame[own], kind="stable")])
    lines.append("</annotations>")
    return "\n".join(lines) + "\n"


def _meta(drive: SimulatedDrive, camera: str) -> list[str]:
    model, step = drive.rig.cameras[camera].model, drive.scenario.annotate_every
    last = drive.frame_epoch_ns.size - 1
    made = datetime.fromtimestamp(drive.scenario.start_utc_ns // 1_000_000_000, UTC).isoformat(sep=" ")
    attributes = "".join(
        f"<attribute><name>{name}</name><mutable>False</mutable><input_type>text</input_type>"
        "<default_value></default_value><values></values></attribute>"
        for name in ("skiltnummer", "object")
    )
    return [
        "  <meta>",
        "    <task>",
        "      <id>1</id>",
        f"      <name>{escape(drive.scenario.name)} {escape(camera)}</name>",
        f"      <size>{last // step + 1}</size>",
        "      <mode>interpolation</mode>",
        f"      <created>{made}</created>",
        f"      <updated>{made}</updated>",
        "      <start_frame>0</start_frame>",
        f"      <stop_frame>{last}</stop_frame>",
        f"      <frame_filter>step={step}</frame_filter>",
        f"      <labels><label><name>{LABEL}</name><type>points</type>",
        f"        <attributes>{attributes}</attributes></label></labels>",
        "      <original_size>",
        f"        <width>{model.width_px}</width>",
        f"        <height>{model.height_px}</height>",
        "      </original_size>",
        "    </task>",
        f"    <dumped>{made}</dumped>",
        f"    <source>{escape(camera)}.h264</source>",
        "  </meta>",
    ]


def _track(drive: SimulatedDrive, track: int, index: int, rows: IntArray) -> list[str]:
    step, last = drive.scenario.annotate_every, drive.frame_epoch_ns.size - 1
    attributes = [
        f"      <attribute name={quoteattr(name)}>{escape(str(value))}</attribute>"
        for name, value in (
            ("skiltnummer", drive.objects.skiltnummer[index]),
            ("object", drive.objects.object[index]),
        )
    ]
    frames = drive.sightings.frame[rows]
    lines = [f'  <track id="{track}" label="{LABEL}" source="manual">']
    for i, row in enumerate(rows):
        place = ",".join(f"{value + CORNER_PX:.2f}" for value in drive.sightings.pixel_px[row])
        lines += [_points(int(frames[i]), outside=False, place=place), *attributes, "    </points>"]
        after = int(frames[i]) + step
        lost = i + 1 == rows.size or frames[i + 1] > after
        if lost and after <= last:
            lines += [_points(after, outside=True, place=place), *attributes, "    </points>"]
    lines.append("  </track>")
    return lines


def _points(frame: int, *, outside: bool, place: str) -> str:
    state = f'outside="{outside:d}" occluded="0" keyframe="1"'
    return f'    <points frame="{frame}" {state} points="{place}" z_order="0">'
