from .detection.run import DetectorOptions as DetectorOptions
from .drive import Annotations as Annotations
from .drive import Drive as Drive
from .folder.notes import DriveDoubt as DriveDoubt
from .folder.notes import SkipKind as SkipKind
from .folder.notes import Skipped as Skipped
from .inspection.inspect import inspect_drive as inspect_drive
from .read import read_drive as read_drive
