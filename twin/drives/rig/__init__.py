"""The rig of a drive: its calibration files, and what contradicts them."""
