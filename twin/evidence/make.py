"""Crops of all findings: chosen, cut from pictures that are decoded once, masked, kept."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import sqlalchemy as sa

from twin.drives.frames.read import Frame
from twin.errors import ConfigError
from twin.evidence.crops import Crop, Gap, GapKind
from twin.evidence.cutting import Cut, Patch, cuts_of, patch_of
from twin.evidence.files import TASK, sweep, write_crop
from twin.evidence.log import UNMASKED, log
from twin.evidence.masker import Masker
from twin.evidence.recordings import Lack, Recordings, recordings_of
from twin.evidence.shots import Look, Shot, shots_of
from twin.evidence.subjects import DriveOf, Subject, drives_of, subjects_of
from twin.store import schema
from twin.store.store import Snapshot, Store
from twin.words.gaps import CameraLost, NotShown, OtherSize

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class EvidenceReport:
    """What was made.

    Attributes
    ----------
    n_findings : int
        That ask for a decision, and were looked at.
    n_with_crops : int
        Of these, those that have crops now.
    n_crops : int
        Rows written, be their files new or not.
    n_new_files, n_deleted_files : int
    masker : str
        The network's file, ``geometry``, or ``none`` for unmasked crops.
    gaps : tuple of Gap
        By finding and drive.
    """

    n_findings: int
    n_with_crops: int
    n_crops: int
    n_new_files: int
    n_deleted_files: int
    masker: str
    gaps: tuple[Gap, ...]

    def as_json(self) -> dict[str, Any]:
        """Return what ``--json`` prints."""
        plain = {one.name: getattr(self, one.name) for one in fields(self)}
        return {**plain, "gaps": [gap.as_json() for gap in self.gaps]}


def make_evidence(
    store: Store,
    *,
    masker: Masker | None = None,
    missing_only: bool = False,
    unmasked_reason: str | None = None,
    by: str | None = None,
    progress: Progress | None = None,
) -> EvidenceReport:
    """Make the crops of every finding that asks for a decision, and delete those of findings that are gone.

    Run again with nothing new it makes the same files again, and leaves them as they are. A finding that has
    crops keeps them where none can be made now, since the drive's pictures are away.

    Parameters
    ----------
    store : Store
        Matched.
    masker : Masker, optional
        Finds people and vehicles; without one, all but the signs' faces is made unrecognisable.
    missing_only : bool
        Whether findings that have crops are left as they are. Unmasked crops count for none, unless such are
        asked for.
    unmasked_reason : str, optional
        Why nothing is to be masked: kept in the store's log. Such crops never leave by an export.
    by : str, optional
        Who asks for that; needed with it.
    progress : callable, optional
        Called with one sentence a step.

    Raises
    ------
    StoreError, RefusedError
        Nothing was matched, or not since drives or mirror changed; or another run is at work.
    ConfigError
        Unmasked crops without a reason or a name.
    """
    if unmasked_reason is not None and not (unmasked_reason.strip() and (by or "").strip()):
        raise ConfigError("Crops without masks need a reason and a name: both are kept in the store's log.")
    say = progress or (lambda _text: None)
    with store.alone(*TASK):
        n_swept = sweep(store)
        with store.snapshot() as view:
            method = view.matched()["method"]
            have = _with_crops(view, masked=unmasked_reason is None) if missing_only else set()
            subjects = subjects_of(view, method, have)
            ids = {d for one in subjects for d in (*one.drive_ids, *one.seen)}
            drives = drives_of(view, ids)
        recordings = {i: recordings_of(d.name, d.folder, d.rig) for i, d in drives.items()}
        run = _Run(store, masker, unmasked_reason, by or "", say)
        run.plan(subjects, drives, recordings)
        run.decode(drives, recordings)
        gaps = run.finish(subjects)
        n_deleted = n_swept + sweep(store)
    return EvidenceReport(
        n_findings=len(subjects),
        n_with_crops=run.n_with_crops(subjects),
        n_crops=run.n_crops,
        n_new_files=run.n_new_files,
        n_deleted_files=n_deleted,
        masker="none" if unmasked_reason is not None else masker.name if masker else "geometry",
        gaps=gaps,
    )


def _with_crops(view: Snapshot, *, masked: bool) -> set[str]:
    """Ids of the findings that have crops; of masked ones alone where these are asked for."""
    crop = schema.crop.c
    asked = sa.select(crop.change_id).distinct()
    return {row["change_id"] for row in view.rows(asked.where(crop.is_masked) if masked else asked)}


@dataclass(slots=True)
class _View:
    """A view that is being made: the best patch so far, then its crops."""

    shot: Shot
    best: Patch | None = None
    last_frame: int = 0
    crops: tuple[Crop, ...] = ()


@dataclass(slots=True)
class _Run:
    """One run: views open while frames come, and what was written."""

    store: Store
    masker: Masker | None
    unmasked_reason: str | None
    by: str
    say: Progress
    views: list[_View] = field(default_factory=list)
    lacks: dict[str, list[tuple[str, Lack]]] = field(default_factory=lambda: defaultdict(list))
    n_new_files: int = 0
    n_crops: int = 0

    def plan(
        self,
        subjects: Sequence[Subject],
        drives: Mapping[str, DriveOf],
        recordings: Mapping[str, Recordings],
    ) -> None:
        """Choose the pictures."""
        self.say(f"choosing pictures of {len(subjects):,} findings")
        for subject in subjects:
            lacks = self.lacks[subject.change_id]
            shots = shots_of(subject, drives, recordings, lacks)
            if not shots and not lacks:
                kind = GapKind.OUT_OF_VIEW if subject.seen else GapKind.NEVER_IN_VIEW
                lacks.append(("", Lack(kind, NotShown())))
            for shot in shots:
                last = max(look.frame for look in shot.looks)
                self.views.append(_View(shot, last_frame=last))

    def decode(self, drives: Mapping[str, DriveOf], recordings: Mapping[str, Recordings]) -> None:
        """Decode each camera's pictures once, and make the crops of a view when its last frame has come."""
        of_camera: dict[tuple[str, str], list[_View]] = defaultdict(list)
        for view in self.views:
            first = view.shot.looks[0]
            of_camera[first.drive_id, first.camera].append(view)
        for (drive_id, camera), views in sorted(of_camera.items()):
            self._decode_camera(drives[drive_id], recordings[drive_id], camera, views)

    def _decode_camera(
        self, drive: DriveOf, recording: Recordings, camera: str, views: Sequence[_View]
    ) -> None:
        model = drive.rig.camera(camera).model
        wanted = _by_frame(views)
        lacks: list[Lack] = []
        n_other = 0
        for n_done, frame in enumerate(recording.decoded(camera, sorted(wanted), lacks), start=1):
            if frame.image.shape[:2] != (model.height_px, model.width_px):
                n_other += 1
                continue
            self._take(frame, wanted[frame.number])
            self._close(views, frame.number)
            if n_done % 20 == 0:
                self.say(f"{drive.name}, {camera}: {n_done:,} of {len(wanted):,} pictures")
        self._close(views, None)
        if n_other:
            other = OtherSize(n_other, camera, drive.name, model.width_px, model.height_px)
            lacks.append(Lack(GapKind.OTHER_SIZE, other))
        for view in views:
            if not view.crops:
                lost = lacks or [Lack(GapKind.FRAME_LOST, CameraLost(camera))]
                self.lacks[view.shot.change_id] += [(drive.drive_id, lack) for lack in lost]

    def _take(self, frame: Frame, asked: Sequence[tuple[_View, Look]]) -> None:
        for view, look in asked:
            patch = patch_of(frame.image, look, view.shot.codes, self.masker)
            if view.best is None or _is_better(patch, view.best):
                view.best = patch

    def _close(self, views: Sequence[_View], number: int | None) -> None:
        """Write the files of views whose last frame has come; of all of them where none comes any more."""
        folder = self.store.pictures
        for view in views:
            if view.best is None or (number is not None and view.last_frame > number):
                continue
            is_masked = self.unmasked_reason is None
            cuts = cuts_of(view.best, self.masker, is_masked=is_masked)
            crops = []
            for cut in cuts:
                sha256, is_new = write_crop(folder, cut.content)
                self.n_new_files += is_new
                crops.append(_crop(view, cut, sha256, is_masked=is_masked))
            view.crops, view.best = tuple(crops), None

    def finish(self, subjects: Sequence[Subject]) -> tuple[Gap, ...]:
        """Write the rows, after their files, and return the gaps."""
        made: dict[str, list[tuple[Crop, ...]]] = defaultdict(list)
        for view in self.views:
            if view.crops:
                made[view.shot.change_id].append(view.crops)
        rows = [crop.to_row() for views in made.values() for crop in _numbered(views)]
        self.n_crops = len(rows)
        gaps = tuple(_gaps(self.lacks))
        crop, gap, change = schema.crop, schema.crop_gap, schema.change.c
        with self.store.transaction() as connection:
            for table in (crop, gap):
                gone = table.c.change_id.not_in(sa.select(change.change_id))
                connection.execute(sa.delete(table).where(gone))
            for change_id in made:
                connection.execute(sa.delete(crop).where(crop.c.change_id == change_id))
            for subject in subjects:
                connection.execute(sa.delete(gap).where(gap.c.change_id == subject.change_id))
            if rows:
                connection.execute(sa.insert(crop), rows)
            if gaps:
                connection.execute(sa.insert(gap), [one.to_row() for one in gaps])
            if rows and self.unmasked_reason is not None:
                log(connection, UNMASKED, self.by, self.unmasked_reason, len(rows), sorted(made))
        return gaps

    def n_with_crops(self, subjects: Sequence[Subject]) -> int:
        """How many of these findings have crops now, be they of this run or of an earlier one."""
        have = {row["change_id"] for row in self.store.rows(sa.select(schema.crop.c.change_id).distinct())}
        return sum(subject.change_id in have for subject in subjects)


def _by_frame(views: Sequence[_View]) -> Mapping[int, list[tuple[_View, Look]]]:
    wanted: dict[int, list[tuple[_View, Look]]] = defaultdict(list)
    for view in views:
        for look in view.shot.looks:
            wanted[look.frame].append((view, look))
    return wanted


def _is_better(patch: Patch, than: Patch) -> bool:
    """Whether the face is known better, or as well and sharper."""
    if bool(patch.faces_px) != bool(than.faces_px):
        return bool(patch.faces_px)
    return patch.sharpness > than.sharpness


def _crop(view: _View, cut: Cut, sha256: str, *, is_masked: bool) -> Crop:
    look = view.shot.looks[0] if view.best is None else view.best.look
    return Crop(
        change_id=view.shot.change_id,
        number=view.shot.number,
        role=cut.role,
        drive_id=look.drive_id,
        camera=look.camera,
        frame=look.frame,
        epoch_ns=look.epoch_ns,
        range_m=round(look.sight.range_m, 2),
        sha256=sha256,
        width_px=cut.width_px,
        height_px=cut.height_px,
        is_masked=is_masked,
        proof=cut.proof,
    )


def _numbered(views: Sequence[tuple[Crop, ...]]) -> Iterator[Crop]:
    """Number the views that came about from 0; those whose faces are known come first."""
    ordered = sorted(views, key=lambda crops: (not crops[0].proof.faces_px, crops[0].number))
    for number, crops in enumerate(ordered):
        for crop in crops:
            yield replace(crop, number=number)


def _gaps(lacks: Mapping[str, Sequence[tuple[str, Lack]]]) -> Iterator[Gap]:
    for change_id, told in lacks.items():
        for drive_id, lack in dict.fromkeys(told):
            yield Gap(change_id, drive_id, lack.kind, lack.why)
