"""Calibration of the car's cameras: pictures in, rig files and reports out."""
