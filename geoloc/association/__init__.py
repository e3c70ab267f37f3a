"""Sightings without ids → objects: bearings, points seen along them, tracks, faces and strays."""
