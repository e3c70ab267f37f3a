"""Simulated sightings → CVAT XML 1.1, as CVAT exports a video task with point tracks."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from geoloc.simulation.simulate import SimulatedDrive
from twin.drives.annotations.write_cvat import CvatRow, CvatTask, CvatTrack
from twin.drives.annotations.write_cvat import cvat_document as document_of


def cvat_document(drive: SimulatedDrive, camera: str) -> str:
    """Return the annotations of one camera.

    One track an object with one point a key frame, the foot of the pole; a track that loses its object ends
    with ``outside="1"`` and goes on where the object comes back.
    """
    model, step, seen = drive.rig.cameras[camera].model, drive.scenario.annotate_every, drive.sightings
    task = CvatTask(
        name=f"{drive.scenario.name} {camera}",
        source=f"{camera}.h264",
        width_px=model.width_px,
        height_px=model.height_px,
        last_frame=drive.frame_epoch_ns.size - 1,
        made=datetime.fromtimestamp(drive.scenario.start_utc_ns // 1_000_000_000, UTC),
        step=step,
        has_gaps=True,
    )
    of_camera = seen.camera == camera
    tracks = []
    for index in np.unique(seen.object_index[of_camera]).tolist():
        own = np.flatnonzero(of_camera & (seen.object_index == index))
        rows = own[np.argsort(seen.frame[own], kind="stable")]
        places = zip(seen.frame[rows].tolist(), seen.pixel_px[rows].tolist(), strict=True)
        said = {
            "skiltnummer": str(drive.objects.skiltnummer[index]),
            "object": str(drive.objects.object[index]),
        }
        tracks.append(CvatTrack([CvatRow(frame, tuple(place)) for frame, place in places], said))
    return document_of(task, tracks)
