"""Change sets as JSON.

API Skriv takes it too, but its documentation shows no JSON of enum values and associations: they are written
here as the XML has them (``"enum": [2868]``, ``"nvdbId": [{"verdi": 1}]``). To send, XML is the safe form.
"""

from __future__ import annotations

import json

from nvdb.endringssett.document import Endringssett
from nvdb.endringssett.read_tree import endringssett_from_tree
from nvdb.endringssett.write_tree import tree_from_endringssett
from nvdb.errors import SchemaError


def to_json(sett: Endringssett) -> bytes:
    """Write a set as a JSON document in UTF-8."""
    return (json.dumps(tree_from_endringssett(sett), ensure_ascii=False, indent=1) + "\n").encode()


def from_json(document: bytes | str) -> Endringssett:
    """Read a set from JSON.

    Raises
    ------
    SchemaError
        Not JSON, or with a part that is not written here.
    """
    try:
        tree = json.loads(document)
    except (ValueError, RecursionError) as error:
        msg = f"The change set is not readable JSON ({error}): check where it comes from."
        raise SchemaError(msg) from error
    return endringssett_from_tree(tree)
