"""From corners in pictures to rays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from geoloc.calibration.extrinsics.observations import Sighting, Tag, TagPicture
from geoloc.cameras.base import CameraModel
from geoloc.errors import CalibrationError


def sightings_in(
    models: Mapping[str, CameraModel], pictures: Sequence[TagPicture], tags: Mapping[int, Tag]
) -> list[Sighting]:
    """Find the rays to every tag of the layout in every picture.

    Raises
    ------
    CalibrationError
        If no camera on the car sees a tag, or a picture shows one twice.
    """
    sightings = [s for p in pictures for s in _sightings_of(p, models[p.camera], tags)]
    on_car = {p.camera for p in pictures if p.on_car}
    if not any(s.view in on_car for s in sightings):
        raise CalibrationError(
            "No camera on the car sees a tag or a board of the layout: check the family (36h11), the ids, the"
            " board's description, and that the pictures are sharp; a board on the floor needs large markers."
        )
    return sightings


def _sightings_of(picture: TagPicture, model: CameraModel, tags: Mapping[int, Tag]) -> list[Sighting]:
    ids = picture.tag_ids.tolist()
    repeated = sorted({tag for tag in ids if ids.count(tag) > 1}) if picture.points_m is None else []
    if repeated:
        raise CalibrationError(
            f"{picture.name} shows tag {', '.join(map(str, repeated))} twice: take one of them away, or print"
            " tags with different ids, and take the pictures again."
        )
    sightings = []
    for i, tag in enumerate(ids):
        if tag not in tags:
            continue
        rays = model.rays(picture.corners_px[i, :, 0], picture.corners_px[i, :, 1], slopes=True)
        if not rays.inside.all():
            continue
        sightings.append(
            Sighting(
                camera=picture.camera,
                view=picture.camera if picture.on_car else f"{picture.camera}/{picture.name}",
                tag=tag,
                picture=picture.name,
                points_m=tags[tag].corners_m() if picture.points_m is None else picture.points_m[i],
                ray=np.stack(rays.ray, axis=-1),
                px_from_ray=np.asarray(np.linalg.pinv(rays.by_pixel()), dtype=np.float64),
            )
        )
    return sightings
