"""Recordings → :class:`Drive`, whatever the logger and the annotation tool.

=======================  =============================================================================
read_drive               the door: a folder, read and checked
Drive, Annotations       what every reader returns
DriveDoubt               what a warning of a drive is about
Skipped, SkipKind        what was left out, and why
DetectorOptions          how a network is run that finds the signs instead of an annotator
inspect_drive            what a folder holds, what of it is understood, and what is missing
=======================  =============================================================================

Behind it: one module a file format, each of which takes the bytes of one file and returns arrays with a count
of what it left out. The names are loaded when they are first used; which module has which is written in
``__init__.pyi``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
