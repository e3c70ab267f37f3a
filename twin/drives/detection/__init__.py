"""Signs found by a network instead of by hand: frames → boxes → tracks → the same annotations.

:func:`twin.drives.detection.read.read_detections` is the door. The network runs on this machine, nothing is
sent anywhere, and no picture is kept: only boxes, classes and scores come out.
"""
