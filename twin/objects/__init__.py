"""Road objects beside signs: what was drawn on the ground → places, sizes, and how NVDB differs."""

from twin.objects.against_nvdb import Compared, Comparison, GroundVerdict, compare
from twin.objects.files import write_objects
from twin.objects.locate import DriveObjects, GroundObject, locate_objects
from twin.objects.nvdb import NvdbObjects, fetch_nvdb_objects, read_nvdb_objects
from twin.objects.rows import ComparedRow, ObjectRow, ObjectsReport

__all__ = [
    "Compared",
    "ComparedRow",
    "Comparison",
    "DriveObjects",
    "GroundObject",
    "GroundVerdict",
    "NvdbObjects",
    "ObjectRow",
    "ObjectsReport",
    "compare",
    "fetch_nvdb_objects",
    "locate_objects",
    "read_nvdb_objects",
    "write_objects",
]
