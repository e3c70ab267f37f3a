"""Calibration of cameras from corners of printed boards: intrinsics with covariance, compared models."""
