"""Whether annotations were drawn on pictures of the size that the camera was calibrated at."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from geoloc.arrays import FloatArray
from geoloc.rig.rig import Rig, RigCamera
from twin.drives.annotations.camera_of_file import CameraChooser
from twin.drives.annotations.formats.shapes import AnnotationFile, Shape
from twin.drives.drive import Annotations
from twin.errors import DriveError

_FEW = 5
"""So many slips of the hand say nothing of the picture's size."""
_MOST_OUTSIDE = 0.3
_ENOUGH = 20


def check_size(shape: Shape, camera: RigCamera, where: str, source: str) -> None:
    """Refuse a shape that says it was drawn on a picture of another size.

    Raises
    ------
    DriveError
        Naming both sizes.
    """
    size = (camera.model.width_px, camera.model.height_px)
    if shape.size_px is not None and shape.size_px != size:
        drawn = f"{shape.size_px[0]} x {shape.size_px[1]}"
        raise DriveError(
            f"{where} was drawn on images of {drawn} pixels, but {camera.name} has {size[0]} x {size[1]} in"
            f" {source}: annotate the recording in its own size, or give the rig it belongs to."
        )


def check_reach(file: AnnotationFile, chooser: CameraChooser, source: str) -> set[str]:
    """Refuse shapes that do not say how large their picture was, and reach far beyond the camera's.

    Parameters
    ----------
    file : AnnotationFile
    chooser : CameraChooser
        Of that file.
    source : str
        The rig, for messages.

    Returns
    -------
    set of str
        Cameras that have such shapes.

    Raises
    ------
    DriveError
        If more than 30 % of a camera's lie outside its picture, and more than a few.
    """
    by_camera: dict[str, list[tuple[float, float]]] = {}
    cameras: dict[str, RigCamera] = {}
    for shape in file.shapes:
        if shape.size_px is None and not shape.is_fraction:
            camera = chooser.of(shape)
            cameras[camera.name] = camera
            by_camera.setdefault(camera.name, []).append(shape.pixel_px)
    for name, pixels in by_camera.items():
        _check_reach(np.array(pixels, dtype=np.float64), cameras[name], file.where, source)
    return set(by_camera)


def reach_warnings(annotations: Annotations, cameras: Iterable[str], rig: Rig) -> list[str]:
    """Tell of cameras of whose pictures only the upper left quarter was annotated.

    Feet stand below the horizon and many signs to the right: hardly any drive has none of them.

    Parameters
    ----------
    annotations : Annotations
    cameras : iterable of str
        Those whose annotations do not say how large their pictures were.
    rig : Rig
    """
    warnings = []
    for name in sorted(cameras):
        pixel_px, model = annotations.pixel_px[annotations.camera == name], rig.camera(name).model
        size = np.array([model.width_px, model.height_px])
        if len(pixel_px) < _ENOUGH or np.any(pixel_px > 0.5 * size):
            continue
        warnings.append(
            f"All {len(pixel_px):,} annotations of {name} lie in the upper left quarter of its"
            f" {size[0]} x {size[1]} pixels in {rig.source}: if they were drawn on smaller pictures, give the"
            " calibration of pictures of that size."
        )
    return warnings


def _check_reach(pixel_px: FloatArray, camera: RigCamera, where: str, source: str) -> None:
    width, height = camera.model.width_px, camera.model.height_px
    beyond = np.any(pixel_px > np.array([width, height]) - 0.5, axis=1)
    if np.count_nonzero(beyond) <= max(_FEW, _MOST_OUTSIDE * len(pixel_px)):
        return
    x, y = pixel_px.max(axis=0) + 0.5
    outside = f"{np.count_nonzero(beyond)} of {len(pixel_px)} annotations in {where}"
    raise DriveError(
        f"{outside} lie outside the {width} x {height} pixels of {camera.name} in {source}, as far as"
        f" x = {x:.0f}, y = {y:.0f}: they were drawn on larger pictures. Give the calibration of pictures"
        " of that size, or annotate the recording in its own."
    )
