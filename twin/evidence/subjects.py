"""What crops are to be made of: the findings of the last match, and the drives that can show them."""

from __future__ import annotations

import json
import zlib
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import sqlalchemy as sa

from geoloc.rig.rig import Rig, rig_from_document, without_template_masks
from geoloc.trajectory.poses import Poses
from twin.decisions.evidence import Evidence, present_evidence
from twin.decisions.findings import latest_findings
from twin.evidence.sights import Marked, Place
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.records import Covariance, Finding
from twin.store.store import Row, Snapshot

_FOOT = "foot"


@dataclass(frozen=True, slots=True)
class DriveOf:
    """A drive of the store.

    Attributes
    ----------
    folder : str
        That it was ingested from; "" where that is not known.
    cameras : tuple of str
        Those that were annotated.
    """

    drive_id: str
    name: str
    folder: str
    started_ns: int
    rig: Rig
    poses: Poses
    cameras: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Picture:
    """One picture in which a finding's sign was marked."""

    camera: str
    frame: int
    epoch_ns: int
    marked: Marked


@dataclass(frozen=True, slots=True)
class Seen:
    """A finding's sign as one drive saw it.

    Attributes
    ----------
    place : Place
        Where the drive's own estimate puts it.
    is_face : bool
        Whether that is the middle of its face, not its foot.
    """

    place: Place
    is_face: bool
    pictures: tuple[Picture, ...]


@dataclass(frozen=True, slots=True)
class Subject:
    """A finding that crops are to be made of.

    Attributes
    ----------
    place : Place
        Where it stands: measured, or NVDB's position of what was not seen.
    nvdb : Place or None
        NVDB's position.
    codes : tuple of str
        Of its plates.
    seen : mapping of drive_id to Seen
        Empty where nothing was seen.
    """

    change_id: str
    place: Place
    nvdb: Place | None
    covariance_m2: Covariance | None
    codes: tuple[str, ...]
    drive_ids: tuple[str, ...]
    seen: Mapping[str, Seen]


def subjects_of(view: Snapshot, method: str, without: Collection[str] = ()) -> list[Subject]:
    """Return every finding that asks for a decision, in the order of their ids.

    Parameters
    ----------
    method : str
        Whose estimates were matched.
    without : collection of str
        Ids of findings that are left out.
    """
    nvdb = present_evidence(view.rows)
    findings = [one.finding for one in latest_findings(view.rows) if not one.is_quiet]
    findings = [finding for finding in findings if finding.change_id not in without]
    members = _members(view, {_pole(finding) for finding in findings})
    estimates = _estimates(view, method)
    sightings = _sightings(view, method, {member for found in members.values() for member in found})
    return [_subject(f, nvdb.get(f.change_id), members[_pole(f)], estimates, sightings) for f in findings]


def drives_of(view: Snapshot, drive_ids: Collection[str]) -> dict[str, DriveOf]:
    """Return the drives with these ids, each with the folder that it was read from last."""
    d, sets = schema.drive, schema.annotation_set.c
    folders = {
        row["drive_id"]: row["folder"]
        for row in view.rows(sa.select(sets.drive_id, sets.folder).where(sets.is_current))
    }
    asked = sa.select(d).where(d.c.drive_id.in_(list(drive_ids)))
    return {row["drive_id"]: _drive(row, folders.get(row["drive_id"], "")) for row in view.rows(asked)}


def _drive(row: Row, folder: str) -> DriveOf:
    rig, _ = without_template_masks(rig_from_document(json.loads(zlib.decompress(row["rig"])), row["name"]))
    poses = poses_from_blob(row["poses"])
    cameras = tuple(row["cameras"])
    return DriveOf(row["drive_id"], row["name"], folder, row["started_ns"], rig, poses, cameras)


def _subject(
    finding: Finding,
    evidence: Evidence | None,
    members: Sequence[tuple[str, str]],
    estimates: Mapping[tuple[str, str], Place],
    sightings: Mapping[tuple[str, str], Sequence[Row]],
) -> Subject:
    of_drive: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for member in members:
        if member in estimates and sightings.get(member):
            of_drive[member[0]].append(member)
    nvdb = None
    if evidence is not None and evidence.nvdb_east_m is not None and evidence.nvdb_north_m is not None:
        nvdb = Place(evidence.nvdb_east_m, evidence.nvdb_north_m)
    return Subject(
        change_id=finding.change_id,
        place=Place(finding.east_m, finding.north_m),
        nvdb=nvdb,
        covariance_m2=finding.covariance_m2,
        codes=finding.skiltnummer_seen or finding.skiltnummer_nvdb,
        drive_ids=finding.drive_ids,
        seen={drive: _seen(mine, estimates, sightings) for drive, mine in of_drive.items()},
    )


def _seen(
    members: Sequence[tuple[str, str]],
    estimates: Mapping[tuple[str, str], Place],
    sightings: Mapping[tuple[str, str], Sequence[Row]],
) -> Seen:
    """Put together what one drive marked of a pole: its foot where it was marked, and all its faces."""
    with_foot = [m for m in members if any(row["kind"] == _FOOT for row in sightings[m])]
    rows = [row for member in members for row in sightings[member]]
    measured = [row for row in rows if row["is_measured"]]
    of_picture: dict[tuple[str, int], list[Row]] = defaultdict(list)
    for row in measured or rows:
        of_picture[row["camera"], row["frame"]].append(row)
    pictures = tuple(
        Picture(camera, frame, group[0]["epoch_ns"], _marked(group))
        for (camera, frame), group in sorted(of_picture.items())
    )
    return Seen(estimates[(with_foot or list(members))[0]], not with_foot, pictures)


def _marked(rows: Sequence[Row]) -> Marked:
    feet = [(row["u_px"], row["v_px"]) for row in rows if row["kind"] == _FOOT]
    faces = [row for row in rows if row["kind"] != _FOOT]
    return Marked(
        foot_px=feet[0] if feet else None,
        boxes_px=tuple(_box(row) for row in faces if row["width_px"] and row["height_px"]),
        centres_px=tuple((row["u_px"], row["v_px"]) for row in faces if not row["width_px"]),
    )


def _box(row: Row) -> tuple[float, float, float, float]:
    half_width, half_height = row["width_px"] / 2, row["height_px"] / 2
    u, v = row["u_px"], row["v_px"]
    return u - half_width, v - half_height, u + half_width, v + half_height


def _pole(finding: Finding) -> str:
    return str(finding.terms.get("pole") or "")


def _members(view: Snapshot, poles: Collection[str]) -> Mapping[str, list[tuple[str, str]]]:
    found: dict[str, list[tuple[str, str]]] = defaultdict(list)
    t = schema.pole_key
    for row in view.rows(sa.select(t).order_by(t.c.member)):
        if row["pole"] and row["pole"] in poles:
            drive_id, _, name = row["member"].partition(":")
            found[row["pole"]].append((drive_id, name))
    return found


def _estimates(view: Snapshot, method: str) -> dict[tuple[str, str], Place]:
    t = schema.estimate.c
    asked = sa.select(t.drive_id, t.object, t.east_m, t.north_m, t.height_m).where(t.method == method)
    return {
        (row["drive_id"], row["object"]): Place(row["east_m"], row["north_m"], row["height_m"])
        for row in view.rows(asked)
    }


def _sightings(
    view: Snapshot, method: str, members: Collection[tuple[str, str]]
) -> Mapping[tuple[str, str], Sequence[Row]]:
    """Rows of what was marked, by drive and object; outliers and what was not located left out."""
    t = schema.sighting.c
    names = (t.object, t.camera, t.frame, t.epoch_ns, t.kind, t.u_px, t.v_px, t.width_px, t.height_px)
    found: dict[tuple[str, str], list[Row]] = defaultdict(list)
    for drive_id in sorted({drive for drive, _ in members}):
        mine = (t.drive_id == drive_id) & (t.method == method) & ((t.rejected == "") | ~t.is_measured)
        for row in view.rows(sa.select(*names, t.is_measured).where(mine).order_by(t.number)):
            if (drive_id, row["object"]) in members:
                found[drive_id, row["object"]].append(row)
    return found
