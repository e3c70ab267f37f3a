"""Rendered pictures of boards and of a yard with AprilTags, for calibration tests and benchmarks."""
