"""Calibration of the car's cameras: pictures in, rig files and reports out.

- :func:`calibrate_intrinsics` and :func:`write_calibration`: one camera from pictures of a board
- :func:`calibrate_rig`: where the cameras sit on the car, from pictures of AprilTags
- :func:`verify_drive`: the cameras against objects at surveyed positions
- :func:`cameras_from_drives`: the cameras' mounting over the drives in a store
- :func:`write_example`, :func:`write_yard`: rendered pictures to try the first two on
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
