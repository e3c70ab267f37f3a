from .demo import DemoReport as DemoReport
from .demo import run_demo as run_demo
from .sample import make_sample as make_sample
from .simulation import SimulateReport as SimulateReport
from .simulation import simulate as simulate
