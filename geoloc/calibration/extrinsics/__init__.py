"""Where cameras sit on the car: a joint adjustment of AprilTags around it.

:func:`calibrate_extrinsics` takes a `TagPicture` a picture and the `Tag` of every id, and returns
`Extrinsics`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
