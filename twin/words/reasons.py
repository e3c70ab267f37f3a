"""Why a finding is what it is, as kinds with facts: sentences are made of these, and never read again.

Kept in the store as JSON with the kind's name under ``kind`` (:func:`why_to_json`).
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import msgspec


def _snake(name: str) -> str:
    return "".join(f"_{letter.lower()}" if letter.isupper() else letter for letter in name).lstrip("_")


class _Record(msgspec.Struct, frozen=True):
    """A part of a reason."""


class _Kind(msgspec.Struct, frozen=True, tag_field="kind", tag=_snake):
    """Something that a sentence can be made of; its kind is its name in the table of messages."""


class SignSite(_Record, frozen=True):
    """An object of NVDB, with the codes of its plates."""

    nvdb_type: int
    nvdb_id: int
    codes: tuple[str, ...] = ()


class CodesAgree(StrEnum):
    """How the codes seen and those of NVDB go together."""

    NOT_ANNOTATED = "not_annotated"
    NOT_IN_NVDB = "not_in_nvdb"
    SAME = "same"
    SOME = "some"
    FAMILY = "family"
    OTHER = "other"


class TextDiffers(_Record, frozen=True):
    """What a plate reads, and what NVDB says that it reads."""

    code: str
    seen: str
    nvdb: str


class Basis(_Record, frozen=True):
    """What speaks for and against a pair of pole and site.

    Attributes
    ----------
    sigmas : float or None
        Their distance; None where NVDB has no position of its own.
    n_codes : int
        Codes that were seen.
    faces_away : bool
        NVDB says that the sign cannot be read from where it was seen.
    same_side : bool or None
        Of the road; None where it does not count.
    n_drives : int
        That saw it.
    """

    sigmas: float | None
    codes: CodesAgree
    n_codes: int
    texts: tuple[TextDiffers, ...]
    faces_away: bool
    same_side: bool | None
    n_drives: int


class ClockOff(_Kind, frozen=True):
    """The camera clock does not fit the track."""

    off_ms: float


class ShutterImpossible(_Kind, frozen=True):
    """The rolling shutter that was found cannot be."""


class CameraTurned(_Kind, frozen=True):
    """A camera sits otherwise than its calibration says."""

    camera: str
    turned_deg: float


class CamerasDisagree(_Kind, frozen=True):
    """The cameras place the same objects apart."""


class SightingsContradict(_Kind, frozen=True):
    """Too many sightings are outliers."""

    n_outliers: int
    n_all: int


class CameraPoor(_Kind, frozen=True):
    """A camera's annotations lie far from where the drive places them."""

    camera: str


class Told(_Kind, frozen=True):
    """A text that older versions kept in the place of a kind with facts."""

    text: str


Misfit = (
    ClockOff | ShutterImpossible | CameraTurned | CamerasDisagree | SightingsContradict | CameraPoor | Told
)
"""In which way a drive does not fit itself."""


class VerdictChanged(_Kind, frozen=True):
    """Another verdict than before."""

    then: str
    now: str


class CodesSeenChanged(_Kind, frozen=True):
    """Other sign codes were seen."""

    then: tuple[str, ...]
    now: tuple[str, ...]


class CodesKnownChanged(_Kind, frozen=True):
    """NVDB has other sign codes."""

    then: tuple[str, ...]
    now: tuple[str, ...]


class VersionChanged(_Kind, frozen=True):
    """NVDB has another version of the object."""

    then: int | None
    now: int | None


class NvdbMoved(_Kind, frozen=True):
    """NVDB has the object elsewhere."""

    moved_m: float


class MeasuredMoved(_Kind, frozen=True):
    """It was measured elsewhere than before, further off than chance explains."""

    moved_m: float


Difference = (
    VerdictChanged | CodesSeenChanged | CodesKnownChanged | VersionChanged | NvdbMoved | MeasuredMoved
)
"""What has changed of a finding since it was decided."""


class AsInNvdb(_Kind, frozen=True):
    """It stands where NVDB has it."""

    site: SignSite
    distance_m: float
    sigma_m: float
    basis: Basis


class Moved(_Kind, frozen=True):
    """It stands elsewhere than NVDB has it."""

    site: SignSite
    distance_m: float
    sigma_m: float
    tolerance_m: float
    basis: Basis


class NoOwnPosition(_Kind, frozen=True):
    """NVDB has it on the centre line, and here is its position."""

    site: SignSite
    sigma_m: float
    basis: Basis


class UnsureTakenDown(_Kind, frozen=True):
    """The likeliest site, unless the sign is gone since."""

    site: SignSite
    p: float
    basis: Basis


class UnsureOfSite(_Kind, frozen=True):
    """The likeliest site, and another one is nearly as likely."""

    site: SignSite
    p: float
    rival: SignSite
    basis: Basis


class UnsureOrNew(_Kind, frozen=True):
    """The likeliest site, and a sign that NVDB does not have is nearly as likely."""

    site: SignSite
    p: float
    basis: Basis


class New(_Kind, frozen=True):
    """NVDB has no sign for it."""

    codes: tuple[str, ...]
    within_m: float


class OutsideMirror(_Kind, frozen=True):
    """NVDB has no sign at all about it: the place may not be mirrored."""

    codes: tuple[str, ...]
    within_m: float


class NewOrKnown(_Kind, frozen=True):
    """New, or a site that moved or changed."""

    codes: tuple[str, ...]
    site: SignSite


class StoodHere(_Kind, frozen=True):
    """A later drive did not see it."""

    codes: tuple[str, ...]


class Missing(_Kind, frozen=True):
    """Not seen where it should be."""

    site: SignSite
    n_frames: int
    n_drives: int


class PerhapsMissing(_Kind, frozen=True):
    """Not seen for certain: a sign near it may be this one."""

    site: SignSite
    n_frames: int


class NotObservable(_Kind, frozen=True):
    """Too few pictures to tell."""

    site: SignSite
    n_frames: int
    min_views: int


class WrongType(_Kind, frozen=True):
    """A plate has another code than NVDB says."""

    nvdb_id: int
    known: str
    seen: str


class WrongTypeDisputed(_Kind, frozen=True):
    """The same, where not all drives read it; `readings` in the order of time."""

    nvdb_id: int
    known: str
    seen: str
    readings: tuple[str, ...]


class UnclearType(_Kind, frozen=True):
    """Drives disagree on a plate's code."""

    nvdb_id: int
    known: str
    readings: tuple[str, ...]


class NewPlate(_Kind, frozen=True):
    """One plate more than NVDB has."""

    seen: str
    site: SignSite


class MissingPlate(_Kind, frozen=True):
    """A plate that was not seen though the others of its pole were."""

    nvdb_id: int
    code: str
    site: SignSite


class DriveDoesNotFit(_Kind, frozen=True):
    """A drive whose positions are not trusted, and in which ways it does not fit itself."""

    drive: str
    misfits: tuple[Misfit, ...]


class DriveAhead(_Kind, frozen=True):
    """A drive whose signs fit NVDB's after one shift along the road: they lie ahead of them."""

    drive: str
    along_m: float
    late_s: float


class DriveBehind(_Kind, frozen=True):
    """The same, where they lie behind."""

    drive: str
    along_m: float
    early_s: float


DriveDoubted = DriveDoesNotFit | DriveAhead | DriveBehind
"""Why the positions of a drive are not trusted."""


class Doubtful(_Kind, frozen=True):
    """What would contradict NVDB, if the drive were to be trusted."""

    doubt: DriveDoubted
    verdict: str
    reason: Why


class Reopened(_Kind, frozen=True):
    """What was decided, and what has changed since.

    Attributes
    ----------
    decision, at, by, comment : str
        As in the log of decisions.
    """

    decision: str
    at: str
    by: str
    comment: str
    changes: tuple[Difference, ...]


class Temporary(_Kind, frozen=True):
    """Why something was dismissed: the sign stands for road works; `last_seen` is a day, "" if not known."""

    last_seen: str


class NearTemporary(_Kind, frozen=True):
    """Why twin dismissed something: it belongs to road works of which a person dismissed a sign."""

    change_id: str
    at: str
    by: str


class WorksOver(_Kind, frozen=True):
    """Why something that twin dismissed is open again: no dismissed road works speak for it any more."""


Cause = Reopened | Temporary | NearTemporary | WorksOver
"""What the log of decisions keeps of an entry besides the words of people."""

Why = (
    AsInNvdb
    | Moved
    | NoOwnPosition
    | UnsureTakenDown
    | UnsureOfSite
    | UnsureOrNew
    | New
    | OutsideMirror
    | NewOrKnown
    | StoodHere
    | Missing
    | PerhapsMissing
    | NotObservable
    | WrongType
    | WrongTypeDisputed
    | UnclearType
    | NewPlate
    | MissingPlate
    | Doubtful
    | Told
)
"""Why a finding is what it is."""


Sayable = Why | DriveDoubted | Cause | Misfit | Difference
"""Everything that a sentence, or a clause of one, is made of."""


def why_to_json(why: Why | Misfit | Cause) -> dict[str, Any]:
    """Return the JSON object that the store keeps."""
    document: dict[str, Any] = msgspec.to_builtins(why)
    return document


def why_from_json(document: object) -> Why:
    """Take a reason back from the store's JSON.

    Raises
    ------
    msgspec.ValidationError
        It is of no kind that this version knows.
    """
    return msgspec.convert(document, Why)  # type: ignore[no-any-return]


def cause_from_json(document: object) -> Cause:
    """Take a cause back from the log of decisions."""
    return msgspec.convert(document, Cause)  # type: ignore[no-any-return]


def misfit_from_json(document: object) -> Misfit:
    """Take a misfit back from the store's JSON; older versions kept its English text."""
    if isinstance(document, str):
        return Told(document)
    return msgspec.convert(document, Misfit)  # type: ignore[no-any-return]
