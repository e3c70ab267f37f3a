"""Recordings → :class:`twin.drives.drive.Drive`, whatever the logger and the annotation tool."""
