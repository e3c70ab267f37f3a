"""Camera models behind one protocol: pixels from camera points, rays from pixels."""

from geoloc.cameras.base import CameraModel
from geoloc.cameras.ftheta import FThetaCamera
from geoloc.cameras.pinhole import PinholeCamera

__all__ = ["CameraModel", "FThetaCamera", "PinholeCamera"]
