"""Recordings → :class:`twin.drives.drive.Drive`, whatever the logger and the annotation tool.

:func:`twin.drives.read.read_drive` is the door. Behind it: one module a file format, each of which takes the
bytes of one file and returns arrays with a count of what it left out.
"""
