"""Change sets → the files of an export: XML to send, JSON to read, what undoing needs, and the provenance."""

from __future__ import annotations

import hashlib
import json
import re
from typing import Any, Final

import twin
from nvdb.endringssett import to_json, to_xml
from twin.changesets.build import ChangeSets, Sett
from twin.changesets.datafangst import datafangst
from twin.changesets.drive_side import height_of
from twin.decisions.log import Entry
from twin.store.kinds import Verdict

PROVENANCE: Final = "proveniens.json"
PREVIEW: Final = "preview-"
"""Before the name of every file about findings that nobody has accepted."""
_MEASURED: Final = frozenset({Verdict.NEW, Verdict.MOVED})
"""Verdicts that bring a measured position into NVDB."""
_OURS: Final = re.compile(
    r"(preview-)?(endringssett-\d+(-before)?\.(xml|json)|datafangst-\d+\.geojson|proveniens\.json)"
)


def files_of(made: ChangeSets) -> dict[str, bytes]:
    """Write change sets.

    ``endringssett-1.xml`` is what is sent, ``endringssett-1.json`` says the same;
    ``datafangst-1.geojson`` says it to Datafangst,
    ``endringssett-1-before.json`` holds the objects as they were, for undoing; ``proveniens.json`` says where
    every change comes from and the SHA-256 of each set. The name of a preview begins with ``preview-``. A set
    in which our own checks found errors is not written. Nothing depends on the clock: the same findings give
    the same bytes.

    Returns
    -------
    dict
        Name → content, the provenance last; empty without findings.
    """
    if not made.findings:
        return {}
    prefix = PREVIEW if made.is_preview else ""
    files: dict[str, bytes] = {}
    setts: list[dict[str, Any]] = []
    for number, sett in enumerate(made.setts, start=1):
        base = f"{prefix}endringssett-{number}"
        own = {} if sett.errors else _files_of_set(base, sett, preview=made.is_preview)
        if own:
            own[f"{prefix}datafangst-{number}.geojson"] = datafangst(made, sett)
        files |= own
        setts.append(
            {
                "file": f"{base}.xml" if own else None,
                "sha256": {name: hashlib.sha256(content).hexdigest() for name, content in own.items()},
                "objects": len(sett.sett.endringer),
                "changes": [key for group in sett.groups for key in group.change_ids],
                "errors": sett.errors,
                "warnings": sett.warnings,
                "cannot_be_undone": sett.not_undone,
            }
        )
    document = {
        "software": f"twin {twin.__version__}",
        "decision": made.decision,
        "match": made.match,
        "sets": setts,
        "changes": _changes(made),
        "left_out": {item.change_id: item.sentence for item in made.left_out},
    }
    return {**files, prefix + PROVENANCE: json_bytes(document)}


def is_change_set_file(name: str) -> bool:
    """Whether a file name is one that :func:`files_of` gives."""
    return _OURS.fullmatch(name) is not None


def json_bytes(document: Any) -> bytes:
    """Write JSON for people and programs alike."""
    return (json.dumps(document, ensure_ascii=False, indent=1) + "\n").encode()


def _files_of_set(base: str, sett: Sett, *, preview: bool) -> dict[str, bytes]:
    files = {f"{base}.xml": to_xml(sett.sett), f"{base}.json": to_json(sett.sett)}
    if not preview:
        files[f"{base}-before.json"] = json_bytes(sett.before)
    return files


def _changes(made: ChangeSets) -> list[dict[str, Any]]:
    where = {
        key: (number, group)
        for number, sett in enumerate(made.setts, start=1)
        for group in sett.groups
        for key in group.change_ids
    }
    return [
        {
            "change_id": key,
            "verdict": finding.verdict,
            "reason": finding.reason,
            "confidence": finding.confidence,
            "terms": finding.terms,
            "set": where[key][0] if key in where else None,
            "operations": [endring.navn for endring in where[key][1].endringer] if key in where else [],
            "decision": _decision(made.decided.get(key)),
            "nvdb": {
                "type": finding.nvdb_type,
                "id": finding.nvdb_id,
                "version": finding.nvdb_version,
                "read": made.read.get(key),
            },
            **_evidence(made, key),
        }
        for key, finding in made.findings.items()
    ]


def _decision(entry: Entry | None) -> dict[str, Any] | None:
    if entry is None:
        return None
    return {name: getattr(entry, name) for name in ("decision", "by", "at", "reason")}


def _evidence(made: ChangeSets, key: str) -> dict[str, Any]:
    seen = made.seen[key]
    return {
        "drives": [
            {
                "drive_id": drive["drive_id"],
                "name": drive["name"],
                "content_sha256": drive["content_sha256"],
                "software": drive["software"],
            }
            for drive in seen.drives
        ],
        "estimates": [estimate["estimate_id"] for estimate in seen.estimates],
        "frames": seen.frames,
        **({"height": height_of(seen).how} if made.findings[key].verdict in _MEASURED else {}),
    }
