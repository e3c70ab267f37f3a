"""Tracks of a detector → objects: what the pictures tore apart or ran together, the geometry puts right.

A track ends where a lorry hides the sign, and every camera has its own. Unlike an annotator's ids, a
tracker's are worth nothing where the rays say otherwise: so they are not reported, but corrected.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from geoloc.association.associate import IdFinding, check_ids
from geoloc.doubts import Doubt
from geoloc.trajectory.trajectory import Trajectory
from twin.drives.drive import Annotations, Drive
from twin.drives.folder.notes import DriveDoubt
from twin.drives.objects.identify import association_input

_TWO_SIGNS = 0.15
"""Smaller shares of a track that fit another place are single wrong boxes: the adjustment leaves them out."""


def with_joined_tracks(drive: Drive, trajectory: Trajectory) -> Drive:
    """Give tracks that show one sign, in any camera, one id; and the two signs of a track that jumped two.

    Parameters
    ----------
    drive : Drive
        In EUREF89, with the tracks of a detector as its objects.
    trajectory : Trajectory
        Of that drive.

    Returns
    -------
    Drive
        With a warning that says how many tracks became how many objects, where that changed.
    """
    annotations = drive.annotations
    if not annotations.frame.size:
        return drive
    findings = check_ids(*association_input(drive, trajectory, annotations.object), annotations.object)
    name = _split(annotations.object, findings)
    if any(finding.kind == "split" for finding in findings):
        split = replace(drive, annotations=replace(annotations, object=name))
        findings = check_ids(*association_input(split, trajectory, name), name)
    name = _merged(name, annotations, [finding.ids for finding in findings if finding.kind == "merge"])
    before, after = (np.unique(names).size for names in (annotations.object, name))
    if np.array_equal(name, annotations.object):
        return drive
    said = Doubt(
        DriveDoubt.IDS, f"The detector's {before:,} tracks are {after:,} objects, by where they stand."
    )
    return replace(
        drive,
        annotations=replace(annotations, object=name),
        warnings=(*drive.warnings, said),
    )


def _split(names: NDArray[np.str_], findings: tuple[IdFinding, ...]) -> NDArray[np.str_]:
    """Give the smaller side of each track that shows two signs a name of its own."""
    renamed = names.astype(object)
    for number, finding in enumerate(findings):
        few, many = sorted(rows.size for rows in finding.rows)
        if finding.kind == "split" and few >= _TWO_SIGNS * (few + many):
            renamed[finding.rows[1]] = f"{finding.ids[0]}/{number + 2}"
    return renamed.astype(np.str_)


def _merged(
    names: NDArray[np.str_], annotations: Annotations, pairs: list[tuple[str, ...]]
) -> NDArray[np.str_]:
    """Join pairs of names, but never two that are seen in one picture."""
    pictures = {
        str(name): set(
            zip(
                annotations.camera[names == name].tolist(),
                annotations.frame[names == name].tolist(),
                strict=True,
            )
        )
        for name in np.unique(names)
    }
    leader = {name: name for name in pictures}
    for one, other in sorted(pairs):
        first, second = sorted((leader[one], leader[other]))
        if first != second and not pictures[first] & pictures[second]:
            pictures[first] |= pictures[second]
            leader = {name: first if of == second else of for name, of in leader.items()}
    return np.array([leader[name] for name in names.tolist()], dtype=np.str_)
