from .ingest import IngestReport as IngestReport
from .ingest import ingest_drive as ingest_drive
