from .server import SkrivReplayServer as SkrivReplayServer
from .world import ReplayObject as ReplayObject
from .world import SkrivWorld as SkrivWorld
