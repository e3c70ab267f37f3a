from .ingest import LocateOptions as LocateOptions
from .ingest import ingest_drive as ingest_drive
from .ingest import locate_drive as locate_drive
from .located import LocatedDrive as LocatedDrive
from .report import IngestReport as IngestReport
from .save import save_drive as save_drive
