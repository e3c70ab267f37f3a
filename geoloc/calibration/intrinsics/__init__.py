"""Intrinsics with covariance from corners of printed boards, and compared camera models."""
