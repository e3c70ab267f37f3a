"""Which finding an operation belongs to, kept in the change set itself.

API Skriv leaves ``kontekst`` to its clients (*Oppbygging*, *Grunnstruktur*). Ours lists the groups of a set:
the findings of each, and the objects that its operations are about, as type and id or by their ``tempId``.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

from nvdb.endringssett import Endring, Endringssett, to_xml
from nvdb.skriv import SetContent
from twin.changesets.operations import Group

_OURS = "twin"
_CHANGE_ID = re.compile(r"[0-9a-f]{12}")


def with_findings(sett: Endringssett, groups: Iterable[Group]) -> Endringssett:
    """Write into a set which findings its operations come from."""
    said = [
        {"findings": group.change_ids, "objects": [object_key(endring) for endring in group.endringer]}
        for group in groups
    ]
    return replace(sett, kontekst=json.dumps({_OURS: said}))


def groups_in(sett: Endringssett) -> tuple[Group, ...]:
    """Take the groups of a set back; none where it names no findings, or other operations than it has."""
    endringer = {object_key(endring): endring for endring in sett.endringer}
    said = _said(sett.kontekst)
    keys = [key for _, objects in said for key in objects]
    if sorted(keys) != sorted(object_key(endring) for endring in sett.endringer):
        return ()
    return tuple(Group(findings, tuple(endringer[key] for key in objects)) for findings, objects in said)


def findings_named(content: SetContent) -> frozenset[str]:
    """Findings of which a registered set says that it brings them in.

    Sets of earlier versions of twin say so in the names of their new objects alone.
    """
    named = {change_id for findings, _ in _said(content.kontekst) for change_id in findings}
    return frozenset(named | {key for name in content.temp_ids if (key := finding_of_name(name))})


def finding_of_name(temp_id: str) -> str | None:
    """The finding that a new object is named after; None where it is not named by twin."""
    head = temp_id.partition("#")[0]
    return head if _CHANGE_ID.fullmatch(head) else None


def digest_of(group: Group) -> str:
    """SHA-256 of what is to be done, whatever set it is part of."""
    return hashlib.sha256(to_xml(Endringssett(datakatalogversjon="", endringer=group.endringer))).hexdigest()


def object_key(endring: Endring) -> str:
    """Name an operation within its set: by its object, of which a set changes no version twice."""
    return endring.temp_id or f"{endring.type_id}:{endring.nvdb_id}"


def _said(kontekst: str | None) -> Sequence[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Findings and objects of each group; nothing where the text is not ours."""
    try:
        groups = json.loads(kontekst or "")[_OURS]
        return [(tuple(map(str, g["findings"])), tuple(map(str, g["objects"]))) for g in groups]
    except (ValueError, KeyError, TypeError):
        return ()
