from .calibrate import CameraPose as CameraPose
from .calibrate import Extrinsics as Extrinsics
from .calibrate import calibrate_extrinsics as calibrate_extrinsics
from .observations import Pose as Pose
from .observations import Sigmas as Sigmas
from .observations import Tag as Tag
from .observations import TagPicture as TagPicture
