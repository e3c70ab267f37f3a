"""Camera models behind one protocol: pixels from camera points, rays from pixels."""

from geoloc.cameras.base import CameraModel
from geoloc.cameras.fisheye import FisheyeCamera
from geoloc.cameras.fisheye624 import Fisheye624Camera
from geoloc.cameras.fov import FovCamera
from geoloc.cameras.ftheta import FThetaCamera
from geoloc.cameras.ocam import OcamCamera
from geoloc.cameras.omni import OmniCamera
from geoloc.cameras.pinhole import PinholeCamera
from geoloc.cameras.windshield import Windshield, WindshieldCamera

__all__ = [
    "CameraModel",
    "FThetaCamera",
    "Fisheye624Camera",
    "FisheyeCamera",
    "FovCamera",
    "OcamCamera",
    "OmniCamera",
    "PinholeCamera",
    "Windshield",
    "WindshieldCamera",
]
