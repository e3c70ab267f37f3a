from .faults import Fault as Fault
from .faults import RequestInfo as RequestInfo
from .server import ReplayServer as ReplayServer
from .world import ReplayWorld as ReplayWorld
