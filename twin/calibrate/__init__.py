"""Calibration of the car's cameras: pictures in, rig files and reports out.

- :func:`calibrate_intrinsics` and :func:`write_calibration`: one camera from pictures of a board
- :func:`calibrate_rig`: where the cameras sit on the car, from pictures of AprilTags
- :func:`verify_drive`: the cameras against objects at surveyed positions
- :func:`cameras_from_drives`: the cameras' mounting over the drives in a store
- :func:`compare_calibrations`: two calibrations of the same cameras, in units of their uncertainty
- :func:`look_at`: which pictures of a board are still missing
- :func:`board_pdf`, :func:`tags_pdf`, :func:`write_yard_plan`: what a calibration needs on paper
- :func:`write_example`, :func:`write_yard`: rendered pictures to try the first two on
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
