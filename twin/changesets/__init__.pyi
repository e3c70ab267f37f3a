from .build import ChangeSets as ChangeSets
from .build import groups_from_store as groups_from_store
from .files import files_of as files_of
from .operations import Group as Group
from .operations import LeftOut as LeftOut
