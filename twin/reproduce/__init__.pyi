from .drawn import figure as figure
from .experiments import Experiment as Experiment
from .experiments import Reproduction as Reproduction
from .files import write_reproduction as write_reproduction
from .run import reproduce as reproduce
from .run import reproduce_simulated as reproduce_simulated
