from .server import Fault as Fault
from .server import ReplayServer as ReplayServer
from .server import RequestInfo as RequestInfo
from .world import ReplayWorld as ReplayWorld
