"""Tracks of several cameras, annotations without ids → objects, by where they stand; a check of given ids."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import IntArray
from geoloc.association.associate import IdFinding, associate_drive, check_ids, join_cameras
from geoloc.doubts import Doubt
from geoloc.locate.observations import Observations
from geoloc.locate.records import Sightings
from geoloc.reasons import Reason
from geoloc.trajectory.trajectory import Trajectory
from twin.drives.annotations.gather import epochs_of, only
from twin.drives.drive import Annotations, Drive
from twin.drives.folder.notes import DriveDoubt, SkipKind, doubts, skipped_annotations
from twin.drives.folder.sensor_names import named_in

FOUND = "auto"
_MAX_WARNINGS = 10
_TWO_SIGNS = 0.15
_FEW_IDS, _MANY_IDS = 3, 0.3


def with_objects(drive: Drive, trajectory: Trajectory) -> Drive:
    """Find out which tracks of several cameras are one object, and which one annotations without an id show.

    Each camera's tracks are numbered by themselves: those that stand at one place get the name of the first.
    Ids that the annotator gave by the attribute ``object`` stay as they are, and what has none joins them
    where it shows the same object; annotations without any id are else named ``auto1``, ``auto2``, … by first
    sighting. Slips of the hand among these are left out and counted.

    Parameters
    ----------
    drive : Drive
        In EUREF89.
    trajectory : Trajectory
        Of that drive.

    Returns
    -------
    Drive
        With warnings that say what was done.

    Raises
    ------
    CalibrationError
        If the rig cannot compute with an annotated camera.
    """
    drive = _with_cameras_joined(drive, trajectory)
    annotations = drive.annotations
    if annotations.has_id.all():
        return drive
    association = associate_drive(*association_input(drive, trajectory, np.full(annotations.kind.size, "")))
    names = _names(annotations, association.object)
    slip = ~annotations.has_id & (association.reason == Reason.SLIP)
    placed = np.where(
        annotations.has_id | (association.object < 0), annotations.object, names[association.object]
    )
    loose = np.count_nonzero(~annotations.has_id)
    found = np.unique(placed[~annotations.has_id & (association.object >= 0)]).size
    warning = (
        f"{loose:,} annotations have no object or track id: by position they are {found:,} objects. Give the"
        " attribute object where that is wrong."
    )
    slips = [skipped_annotations(SkipKind.SLIP, drive.name, int(slip.sum()))] if slip.any() else []
    return replace(
        drive,
        annotations=only(replace(annotations, object=placed.astype(np.str_)), ~slip),
        warnings=(*drive.warnings, Doubt(DriveDoubt.IDS, warning)),
        skipped=(*drive.skipped, *slips),
    )


def has_tracks_to_join(annotations: Annotations) -> bool:
    """Whether several cameras have ids, and some of these are tracks'."""
    return bool(annotations.is_track.any() and np.unique(annotations.camera[annotations.has_id]).size > 1)


def _with_cameras_joined(drive: Drive, trajectory: Trajectory) -> Drive:
    """Give the tracks of several cameras that show one object one id."""
    annotations = drive.annotations
    if not has_tracks_to_join(annotations):
        return drive
    ids = np.where(annotations.has_id, annotations.object, "")
    joined = join_cameras(*association_input(drive, trajectory, ids), ids, annotations.is_track)
    before, after = (np.unique(names[annotations.is_track]).size for names in (ids, joined))
    if np.array_equal(joined, ids):
        return drive
    warning = (
        f"{before:,} tracks have no attribute object: by position they are {after:,} objects, seen by one or"
        " several cameras. Give the attribute object where that is wrong."
    )
    name = np.where(annotations.has_id, joined, annotations.object).astype(np.str_)
    now = dict(zip(ids.tolist(), joined.tolist(), strict=True))
    between = [now.get(one, one) for one in drive.interpolated.object.tolist()]
    return replace(
        drive,
        annotations=replace(annotations, object=name),
        interpolated=replace(drive.interpolated, object=np.array(between, dtype=np.str_)),
        warnings=(*drive.warnings, Doubt(DriveDoubt.IDS, warning)),
    )


def id_warnings(drive: Drive, trajectory: Trajectory, focal_share: float = 0.0) -> tuple[Doubt, ...]:
    """Say which ids mark two signs, and which two ids of one camera mark the same sign.

    Tracks of one sign in several cameras have ids of their own unless the annotator tied them together: that
    is no mistake, and is not reported.

    Parameters
    ----------
    focal_share : float
        One sigma of focal lengths that nobody calibrated, as a share of them.

    Returns
    -------
    tuple of Doubt
        At most ten, and one that counts the rest. Where many ids would be one sign for each camera, the
        cameras are wrong, not the ids: one of the kind `DriveDoubt.CAMERAS_DISAGREE`.
    """
    annotations = drive.annotations
    ids = np.where(annotations.has_id, annotations.object, "")
    if not annotations.has_id.any():
        return ()
    messages: dict[tuple[str, ...], str] = {}
    between: set[str] = set()
    found = check_ids(*association_input(drive, trajectory, ids), ids, focal_share=focal_share)
    for finding in found:
        one, other = (set(annotations.camera[rows].tolist()) for rows in finding.rows)
        few, many = sorted(rows.size for rows in finding.rows)
        if finding.kind == "merge" and one & other and not _in_one_picture(drive, finding.ids):
            messages.setdefault(finding.ids, _one_sign(annotations, finding))
        elif finding.kind == "split" and few >= _TWO_SIGNS * (few + many):
            # Fewer are slips of the hand, which the adjustment leaves out.
            messages.setdefault(finding.ids, _two_signs(annotations, finding))
            if len({_main_camera(annotations, rows) for rows in finding.rows}) > 1:
                between.add(finding.ids[0])
    if len(between) >= _FEW_IDS and len(between) > _MANY_IDS * np.unique(ids[ids != ""]).size:
        disagree = (
            f"The cameras do not agree with one another: {len(between)} ids would be one sign for each. Check"
            " their clocks ([timestamps], camera_offset_ms), mounting and calibration."
        )
        return (Doubt(DriveDoubt.CAMERAS_DISAGREE, disagree),)
    if len(messages) > _MAX_WARNINGS:
        more = f"{len(messages) - _MAX_WARNINGS} more ids look wrong in the same way."
        return doubts(DriveDoubt.IDS, *list(messages.values())[:_MAX_WARNINGS], more)
    return doubts(DriveDoubt.IDS, *messages.values())


def _in_one_picture(drive: Drive, ids: tuple[str, ...]) -> bool:
    """Whether two objects were seen side by side, where the key frames alone do not show them so."""
    pictures: list[set[tuple[str, int]]] = [set(), set()]
    for notes in (drive.annotations, drive.interpolated):
        for seen, name in zip(pictures, ids, strict=True):
            rows = notes.object == name
            seen.update(zip(notes.camera[rows].tolist(), notes.frame[rows].tolist(), strict=True))
    return not pictures[0].isdisjoint(pictures[1])


def _main_camera(annotations: Annotations, rows: IntArray) -> str:
    """The camera of most of the annotations."""
    names: list[str] = sorted(annotations.camera[rows].tolist())
    return Counter(names).most_common(1)[0][0]


def _two_signs(annotations: Annotations, finding: IdFinding) -> str:
    one, other = (_pictures(annotations, rows) for rows in finding.rows)
    return (
        f"The id {finding.ids[0]!r} marks two signs. One: {one}. The other: {other}. Give those of the other"
        " a new id, or correct them."
    )


def _one_sign(annotations: Annotations, finding: IdFinding) -> str:
    one, other = (_pictures(annotations, rows) for rows in finding.rows)
    first, second = finding.ids
    return (
        f"The ids {first!r} and {second!r} are one sign, as one place fits both. {first!r}: {one}."
        f" {second!r}: {other}. Give both the same id."
    )


def _pictures(annotations: Annotations, rows: IntArray) -> str:
    """``22 annotations (skilt 362.50) in C3.xml frames 310 to 345``: what they are, and where."""
    labels, codes = (
        np.unique(names[rows]).tolist() for names in (annotations.label, annotations.skiltnummer)
    )
    texts = dict.fromkeys("/".join(filter(None, names))[:60] for names in (labels, codes))
    called = " ".join(filter(None, texts))
    places = []
    for camera, file in sorted(
        set(zip(annotations.camera[rows].tolist(), annotations.file[rows].tolist(), strict=True))
    ):
        frame = annotations.frame[rows][
            (annotations.camera[rows] == camera) & (annotations.file[rows] == file)
        ]
        of_camera = "" if named_in(file, [camera]) else f" ({camera})"
        places.append(f"{file}{of_camera} frames {frame.min()} to {frame.max()}")
    return f"{rows.size} annotations ({called or 'no label'}) in {', '.join(places)}"


def association_input(
    drive: Drive, trajectory: Trajectory, ids: NDArray[np.str_]
) -> tuple[Observations, NDArray[np.str_]]:
    """Return all annotations of a drive as observations, and their labels.

    Parameters
    ----------
    ids : str (n,)
        Ids by which the track is corrected where its fixes are too poor to compare rays; "" for none.
    """
    annotations, epoch = drive.annotations, _epochs(drive)
    names, number = np.unique(ids, return_inverse=True)
    number = np.where(names[number] == "", -1, number)
    sightings = Sightings(camera=annotations.camera, pixel_px=annotations.pixel_px)
    return Observations(drive.rig, sightings, annotations.kind, number, epoch, trajectory), _labels(
        annotations
    )


def _epochs(drive: Drive) -> IntArray:
    """Epoch of exposure of each annotation."""
    return epochs_of(drive.annotations, drive.frame_epoch_ns) + drive.camera_offset_ns


def _labels(annotations: Annotations) -> NDArray[np.str_]:
    """Sign codes, else the label; "" where the label is one whose codes stand in the attribute."""
    general = np.unique(annotations.label[annotations.skiltnummer != ""])
    word = np.where(np.isin(annotations.label, general), "", annotations.label)
    return np.where(annotations.skiltnummer != "", annotations.skiltnummer, word)


def _names(annotations: Annotations, found: IntArray) -> NDArray[np.str_]:
    """Name of each object that was found: the id that most of its annotations have, else ``auto1``, …."""
    given = set(annotations.object[annotations.has_id].tolist())
    prefix = FOUND
    while any(name.startswith(prefix) for name in given):
        prefix += "_"
    names = []
    number = 0
    for k in range(int(found.max(initial=-1)) + 1):
        ids = Counter(annotations.object[(found == k) & annotations.has_id].tolist())
        if ids:
            names.append(min(ids, key=lambda name: (-ids[name], name)))
        else:
            number += 1
            names.append(f"{prefix}{number}")
    return np.array([*names, ""], dtype=np.str_)
