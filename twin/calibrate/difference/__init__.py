"""Two calibrations of the same camera compared."""
