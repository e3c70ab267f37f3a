"""Simulated drives as folders, and the sample that the demo runs on."""
