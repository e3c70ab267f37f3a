"""Poles that drives saw: estimates of one pole put together, and the frames they were seen in."""
