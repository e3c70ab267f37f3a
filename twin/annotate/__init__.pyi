from .app import AnnotateOptions as AnnotateOptions
from .app import annotate_app as annotate_app
