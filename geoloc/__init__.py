"""Pixels and poses in, positions with covariance out.

Pure geometry: arrays and frozen dataclasses in, arrays and frozen dataclasses out. No database, no
network, no files but calibration files. See CONVENTIONS.md for frames, units and signs.
"""
