"""Lenses of every model, and the calibration files of other tools, which several tests read and write."""

from __future__ import annotations

import json

import numpy as np

from geoloc.cameras import (
    Fisheye624Camera,
    FisheyeCamera,
    FovCamera,
    FThetaCamera,
    OcamCamera,
    OmniCamera,
    PinholeCamera,
)
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera, rig_document

PINHOLE = PinholeCamera(1280, 720, 900.5, 905.25, 645.1, 352.7, (-0.2, 0.05, 8.0e-4, -1.2e-3))
RATIONAL = PinholeCamera(
    1920, 1080, 820.0, 822.0, 955.0, 548.0, (0.4, 0.1, 3e-4, -2e-4, 0.01, 0.75, 0.25, 0.03)
)
FISHEYE = FisheyeCamera(1280, 1024, 470.3, 472.1, 651.2, 498.7, (0.0034, 0.0007, -0.002, 1 / 3e4))
PRISM = PinholeCamera(1920, 1080, 820.0, 822.0, 955.0, 548.0, (*RATIONAL.distortion, 1e-3, 0.0, -4e-4, 1e-4))
FISHEYE62 = Fisheye624Camera(
    1280, 960, 460.0, 461.5, 636.2, 483.7, (0.02, -0.01, 5e-3, -2e-3, 3e-4, -2e-5, 3e-4, -2e-4)
)
FISHEYE624 = Fisheye624Camera(
    1280, 960, 460.0, 461.5, 636.2, 483.7, (*FISHEYE62.distortion, 6e-4, 3e-4, -7e-4, 2e-4)
)
FOV = FovCamera(1280, 960, 685.7, 689.2, 631.3, 485.1, 0.898)
OMNI = OmniCamera(1280, 960, 1.6, 1300.0, 1299.0, 640.2, 480.4, (-0.2, 0.1, 5e-4, 2e-4))
SPHERES = OmniCamera(1280, 960, -0.18, 370.0, 371.0, 640.2, 480.4, alpha=0.58)
EXTENDED = OmniCamera(1280, 960, 0.0, 420.0, 421.0, 640.2, 480.4, alpha=0.6, beta=1.1)
OCAM = OcamCamera(752, 480, 394.6, 241.8, (-206.5, 0.0, 2.2e-3, -4.9e-6, 1.9e-8), 1.0003, 2e-4, -3e-4)
FTHETA = FThetaCamera(1920, 1208, 950.25, 610.5, (0.0, 1e-3, 2e-8))

KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 1e-4, 2.0e-05]
  distortion_model: radtan
  intrinsics: [458.0, 457.0, 367.0, 248.0]
  resolution: [752, 480]
  timeshift_cam_imu: 0.01
cam1:
  T_cn_cnm1:
  - [0.0, -1.0, 0.0, 0.1]
  - [1.0, 0.0, 0.0, 0.2]
  - [0.0, 0.0, 1.0, 0.3]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: omni
  distortion_coeffs: [-0.2, 0.1, 0.0, 0.0]
  distortion_model: radtan
  intrinsics: [1.5, 800.0, 801.0, 370.0, 240.0]
  resolution: [752, 480]
"""
KALIBR_FOV = """cam0:
  camera_model: pinhole
  distortion_coeffs: [0.9]
  distortion_model: fov
  intrinsics: [458.0, 457.0, 367.0, 248.0]
  resolution: [752, 480]
"""
OPENCV = """%YAML:1.0
---
calibration_time: "Thu 19 Nov 2026 10:00:00"
image_width: 1280
image_height: 720
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 9.0050000000000000e+02, 0., 6.4510000000000002e+02, 0.,
       9.0525000000000000e+02, 3.5269999999999999e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.0000000000000001e-01, 5.0000000000000003e-02, 8.0e-04, -1.2e-03, 0. ]
"""
ROS = """image_width: 1280
image_height: 1024
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [470.3, 0, 651.2, 0, 472.1, 498.7, 0, 0, 1]
distortion_model: equidistant
distortion_coefficients:
  rows: 1
  cols: 4
  data: [0.0034, 0.0007, -0.002, 0.000033333333333333335]
"""
OCAMCALIB = """#polynomial coefficients for the DIRECT mapping function

3 -200.0 0.0 0.002

#inverse

2 290.0 150.0

#center: "row" and "column", starting from 0 (C convention)

240.5 390.25

#affine parameters "c", "d", "e"

1.25 0.5 0.25

#image size: "height" and "width"

480 752
"""
LAFIDA = """%YAML:1.0
# Camera calibration parameters
Camera.Iw: 754
Camera.Ih: 480
Camera.nrpol: 3
Camera.a0:-209.5
Camera.a1: 0.0
Camera.a2: 0.002   # no blank after a colon is real
Camera.c: 0.999
Camera.d: -0.003
Camera.e: 0.004
Camera.u0: 392.5
Camera.v0: 243.25
"""
OPENSFM = json.dumps(
    {
        "v2 car front 1920 1080 brown 0.7": {
            "projection_type": "brown",
            "width": 1920,
            "height": 1080,
            "focal_x": 0.75,
            "focal_y": 0.76,
            "c_x": 0.01,
            "c_y": -0.02,
            "k1": -0.1,
            "k2": 0.02,
            "p1": 1e-4,
            "p2": 2e-4,
            "k3": 0.003,
        },
        "wide": {
            "projection_type": "fisheye",
            "width": 600,
            "height": 800,
            "focal": 0.5,
            "k1": 0.01,
            "k2": 0.02,
        },
    }
)
COLMAP = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 2
1 SIMPLE_RADIAL 1920 1080 900.5 960 540 -0.1
7 PINHOLE 640 480 500 501 320.5 240.5
"""
FILES = {
    "kalibr": KALIBR,
    "opencv": OPENCV,
    "colmap": COLMAP,
    "ocamcalib": OCAMCALIB,
    "ocam-yaml": LAFIDA,
    "opensfm": OPENSFM,
    "driveworks": json.dumps(
        rig_document(Rig({"C1": RigCamera("C1", FTHETA, FLU_R_RDF, np.zeros(3))}, {}, "made up"))
    ),
}
