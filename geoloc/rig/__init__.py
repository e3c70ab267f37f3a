"""The rig: cameras, their mounting, antennas, and the DriveWorks JSON file that says so."""
