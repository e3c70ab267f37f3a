"""Calibration checked by drives: against known objects, and over many drives."""
