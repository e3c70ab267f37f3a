from .app import ReviewOptions as ReviewOptions
from .app import review_app as review_app
