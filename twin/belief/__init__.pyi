from .belief import Belief as Belief
from .belief import Believed as Believed
from .belief import believe as believe
from .model import Assumed as Assumed
from .roads import RoadToDrive as RoadToDrive
from .roads import roads_to_drive as roads_to_drive
from .state import State as State
