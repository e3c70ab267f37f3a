from .config import MatchConfig as MatchConfig
from .match_store import MatchReport as MatchReport
from .match_store import match as match
