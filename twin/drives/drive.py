"""A recorded drive, read and checked: what every reader returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray
from geoloc.doubts import Doubt
from geoloc.rig.rig import Rig
from geoloc.trajectory.trajectory import GnssFixes, PoseTrack
from geoloc.trajectory.vehicle_motion import VehicleMotion
from twin.drives.folder.notes import Skipped

if TYPE_CHECKING:
    from twin.drives.frames.clocks import StatedClock
    from twin.drives.frames.find import Pictures


class Annotation(NamedTuple):
    """One row of :class:`Annotations`, or what lies on the ground.

    Of the latter `kind` is ``point``, ``line`` or ``area``, and `outline_px` has the corners; it is empty
    otherwise.
    """

    camera: str
    frame: int
    object: str
    has_id: bool
    label: str
    skiltnummer: str
    text: str
    kind: str
    pixel_px: tuple[float, float]
    box_px: tuple[float, float, float, float]
    file: str
    is_measured: bool = True
    is_track: bool = False
    outline_px: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Annotations:
    """Annotated objects in frames, one row a point or box.

    Attributes
    ----------
    camera : str (n,)
    frame : int64 (n,)
        Absolute frame number in the recording of that camera.
    object : str (n,)
        Unique in the drive: the attribute ``object`` or ``object_id`` as written, which ties one pole
        together across cameras; else the track id, with the camera before it (``C3:12``) where there are
        several files; else one for each shape (``f123.1``).
    has_id : bool (n,)
        Whether the annotator said by an ``object`` attribute or a track which object it is.
    label : str (n,)
        The annotator's label, as written.
    skiltnummer : str (n,)
        Norwegian sign codes on this pole, top down, joined by ``;`` ("362.50;808.1"); "" if unknown. From the
        attribute ``skiltnummer``, else from a label that starts with a sign code.
    text : str (n,)
        What is written on these plates, in the same order and joined alike (";200 m"); "" if not annotated.
        From the attribute ``text`` or ``tekst``, at most 200 characters.
    kind : str (n,)
        ``foot`` (a point where the pole meets the ground) or ``box`` (the sign's face).
    pixel_px : float64 (n, 2)
        The foot, or the centre of the box; (0, 0) is the centre of the first pixel.
    box_px : float64 (n, 4)
        left, top, right, bottom in the same convention; NaN for points.
    file : str (n,)
        Where it stands: a file, or a folder of files of one image each.
    is_measured : bool (n,)
        Whether somebody put it there; False where the annotation tool interpolated it between key frames.
    is_track : bool (n,)
        Whether `object` is a track's id, which says nothing about what other cameras see.
    """

    camera: NDArray[np.str_]
    frame: IntArray
    object: NDArray[np.str_]
    has_id: NDArray[np.bool_]
    label: NDArray[np.str_]
    skiltnummer: NDArray[np.str_]
    text: NDArray[np.str_]
    kind: NDArray[np.str_]
    pixel_px: FloatArray
    box_px: FloatArray
    file: NDArray[np.str_]
    is_measured: NDArray[np.bool_]
    is_track: NDArray[np.bool_]

    @classmethod
    def of(cls, rows: Sequence[Annotation]) -> Self:
        """Return rows as columns."""
        shapes = {"pixel_px": (-1, 2), "box_px": (-1, 4)}
        floats, truths = ("pixel_px", "box_px"), ("has_id", "is_measured", "is_track")
        kinds: dict[str, Any] = {"frame": np.int64, **dict.fromkeys(floats, np.float64)}
        kinds |= dict.fromkeys(truths, np.bool_)
        columns = zip(*rows, strict=True) if rows else ((),) * len(Annotation._fields)
        return cls(
            **{
                name: np.array(column, kinds.get(name, np.str_)).reshape(shapes.get(name, (-1,)))
                for name, column in zip(Annotation._fields, columns, strict=True)
                if name != "outline_px"
            }
        )


@dataclass(frozen=True, slots=True)
class Drive:
    """One recorded drive.

    Attributes
    ----------
    drive_id : str
        First 12 hex digits of the SHA-256 over the content of the GNSS or pose files: the same drive is the
        same id on every machine, also when it is annotated or calibrated anew.
    content_sha256 : str
        Over name and content of every file that was read.
    annotations_sha256 : str
        Over name and content of the annotation files, or over what a detector found; what labels mean is
        not in it.
    name : str
        The folder's, or ``name`` in ``drive.toml``.
    path : str
        Where it was read from.
    rig : Rig
    rig_document : str
        The rig file's text, kept for provenance.
    gnss : tuple of GnssFixes
        One an antenna; empty if `poses` is given.
    poses : PoseTrack or None
    frame_epoch_ns : mapping camera → int64 (frames,)
        UTC host stamp of each frame, by frame number; `stamp_files.NO_STAMP` where it has none.
    annotations : Annotations
        Those that were measured: positions come of them alone.
    interpolated : Annotations
        What an annotation tool put between two key frames: they say that the object was in view in these
        pictures, and nothing of where it stands (:mod:`twin.drives.annotations.key_frames`).
    annotations_complete : bool
        Whether every sign in view was annotated: only then can a sign be missing.
    datum : str
        ``EUREF89``, ``ITRF2014`` or ``ITRF2020``.
    camera_offset_ns : int
        Added to the frame stamps to get the epoch of exposure of the middle row (default 0).
    rolling_shutter_ms : float or None
        From the exposure of the first row to that of the last; None where the drive does not say.
    pole_radius_m : float
        From the visible foot, which annotators mark, to the middle of the pole.
    warnings : tuple of Doubt
        What a user should know, of the kinds of :class:`twin.drives.folder.notes.DriveDoubt`.
    skipped : tuple of Skipped
    pictures : mapping of camera to Pictures
        Videos and image folders that were found; nothing of them is decoded.
    errors : mapping of name to one sigma
        Terms of the error budget that ``drive.toml`` states.
    clock : StatedClock or None
        Why the stamps of the annotated cameras are not known as well as the error budget takes it; None where
        they are.
    other_objects : mapping of label to vegobjekttype
        Labels of annotations that are no signs: they are located, and not compared with NVDB.
    on_ground : tuple of Annotation
        Points, lines and areas on the ground, that somebody drew (`twin.objects` locates them).
    motion : VehicleMotion or None
        What the car measured of its own motion; None where ``drive.toml`` names nothing.
    """

    drive_id: str
    content_sha256: str
    annotations_sha256: str
    name: str
    path: str
    rig: Rig
    rig_document: str
    gnss: tuple[GnssFixes, ...]
    poses: PoseTrack | None
    frame_epoch_ns: Mapping[str, IntArray]
    annotations: Annotations
    annotations_complete: bool
    datum: str
    camera_offset_ns: int
    rolling_shutter_ms: float | None
    pole_radius_m: float
    warnings: tuple[Doubt, ...]
    skipped: tuple[Skipped, ...]
    pictures: Mapping[str, Pictures] = field(default_factory=dict)
    other_objects: Mapping[str, int] = field(default_factory=dict)
    interpolated: Annotations = field(default_factory=lambda: Annotations.of(()))
    errors: Mapping[str, float] = field(default_factory=dict)
    clock: StatedClock | None = None
    on_ground: tuple[Annotation, ...] = ()
    motion: VehicleMotion | None = None

    def annotated_cameras(self) -> set[str]:
        """Cameras of which something was annotated."""
        return {str(camera) for of in (self.annotations, self.interpolated) for camera in of.camera}

    def is_sign(self, annotations: Annotations | None = None) -> NDArray[np.bool_]:
        """Whether each annotation is of a sign, (n,): what has a sign code is one whatever its label.

        Parameters
        ----------
        annotations : Annotations (n,), optional
            Of this drive. Default: those that were measured.
        """
        of = self.annotations if annotations is None else annotations
        rows = zip(of.label.tolist(), (of.skiltnummer != "").tolist(), strict=True)
        return np.array([has_code or label not in self.other_objects for label, has_code in rows], np.bool_)
