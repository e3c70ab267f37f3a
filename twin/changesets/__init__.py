"""From accepted findings to change sets for API Skriv: made, written, sent, undone.

>>> from twin.changesets import files_of, groups_from_store
>>> made = groups_from_store(store)                                  # doctest: +SKIP
>>> [item.sentence for item in made.left_out]                        # doctest: +SKIP

The page ``docs/endringssett.md`` explains which finding becomes which operation.
"""

from twin.changesets.build import ChangeSets, groups_from_store
from twin.changesets.files import files_of
from twin.changesets.operations import Group, LeftOut

__all__ = ["ChangeSets", "Group", "LeftOut", "files_of", "groups_from_store"]
