"""Calibration files of other tools → camera models, and back.

:func:`geoloc.calibration_files.read.read_cameras` is the door: it tells the format by the content. One module
a format, each of which takes the bytes of one file; most can write their own format too.
"""
