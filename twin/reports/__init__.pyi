from .estimate import EstimateExplained as EstimateExplained
from .estimate import explain_estimate as explain_estimate
from .estimate_picture import draw_estimate as draw_estimate
from .evaluation import Evaluation as Evaluation
from .evaluation import evaluate as evaluate
from .store_status import status as status
from .truth import Truth as Truth
from .truth import read_truth as read_truth
