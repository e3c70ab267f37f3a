"""From accepted findings to change sets for API Skriv: made, written, sent, undone.

>>> from twin.changesets import files_of, groups_from_store
>>> made = groups_from_store(store)                                  # doctest: +SKIP
>>> [item.sentence for item in made.left_out]                        # doctest: +SKIP

The page ``docs/endringssett.md`` explains which finding becomes which operation.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
