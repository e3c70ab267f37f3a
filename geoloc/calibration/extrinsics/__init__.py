"""Where cameras sit on the car: a joint adjustment of AprilTags around it.

:func:`geoloc.calibration.extrinsics.calibrate.calibrate_extrinsics` is the door.
"""
