"""What each command prints under ``--json``, as types: msgspec makes schemas of them, tests read with them.

Most outputs are a record of the library, some with a few keys more: `_shape` puts these together.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from inspect import getdoc
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec
import sqlalchemy as sa

from reference.field_texts import written_below
from twin.belief.chosen import BeliefList, RoadList
from twin.calibrate.coverage.look import CoverageReport
from twin.calibrate.difference.compare import CameraCompared
from twin.calibrate.drives.history import Histories
from twin.calibrate.drives.verify import Verification
from twin.calibrate.extrinsics.calibrate import ExtrinsicsReport
from twin.calibrate.intrinsics.report import IntrinsicsReport
from twin.changesets.submit import Submitted
from twin.cli.config import SettingInForce
from twin.decisions.evidence import Evidence
from twin.decisions.explain import DriveOfFinding
from twin.decisions.record import Decided
from twin.drives.inspection.inspect import Inspection
from twin.drives.inspection.sensors import SensorSpan
from twin.evidence.forgetting import Forgotten
from twin.evidence.make import EvidenceReport
from twin.fleet.queue import Added, Job
from twin.fleet.worker import Tally
from twin.ingest import IngestReport
from twin.ingest.pixel import PixelPosition
from twin.matching.match_store import MatchReport
from twin.mirror.sync import SyncPlan, SyncResult
from twin.objects import ObjectsReport
from twin.reports.confidences import ConfidenceReport
from twin.reports.cost import DriveCost
from twin.reports.drive_list import DriveItem
from twin.reports.error_groups import GroupErrors
from twin.reports.estimate import EstimateExplained
from twin.reports.evaluation import MethodResult
from twin.reports.finding_list import FindingList
from twin.reports.sightings import CameraShare
from twin.reports.store_status import Status
from twin.reproduce.experiments import Reproduction
from twin.samples.simulation import SimulateReport
from twin.store import schema
from twin.store.annotation_sets import AnnotationSet
from twin.store.copying import StoreCopied
from twin.store.trimming import Trimmed

Field = tuple[str, Any] | tuple[str, Any, Any]
SAID: dict[str, dict[str, str]] = {}
"""Type → key → what its docstring says of it."""

_SAME_EVERYWHERE = {
    "drive_id": "the drive",
    "drive": "name of the drive",
    "camera": "the camera",
    "cameras": "the cameras",
    "object": "the annotated object",
    "method": "adjusted, single-frame or paper",
    "warnings": "sentences for a person",
    "length_m": "driven, metres",
    "n": "how many",
    "mean": "of the errors, metres",
    "median": "of the errors, metres",
    "p95": "95 % of the errors are smaller, metres",
    "max": "largest error, metres",
    "rmse": "root of the mean square of the errors, metres",
    "east_m": "EPSG:25833, metres",
    "north_m": "EPSG:25833, metres",
    "synced_at": "when NVDB was last asked, UTC",
    "n_annotations": "annotated points and boxes",
    "n_objects": "annotated objects",
}
"""What keys mean wherever they stand, if their record does not say more."""

_OF_COLUMN: Mapping[type, Any] = {
    sa.String: str,
    sa.Float: float,
    sa.Boolean: bool,
    sa.JSON: Any,
}


def attributes_said(kind: type) -> dict[str, str]:
    """Return attribute → meaning, of the section Attributes of a docstring."""
    _, _, section = (getdoc(kind) or "").partition("Attributes\n----------\n")
    found: dict[str, str] = {}
    for names, text in re.findall(
        r"^(\S[^\n]*)\n((?:    [^\n]*\n?|\n)*)", section + "\n", flags=re.MULTILINE
    ):
        meaning = re.sub(r":\w+:`~?([^`]*)`", r"`\1`", " ".join(text.split())).replace("``", "`")
        for name in names.partition(" : ")[0].split(","):
            found[name.strip()] = meaning
    return found | written_below(kind)


def _shape(called: str, /, *sources: type, leave: tuple[str, ...] = (), **more: tuple[Any, str]) -> type:
    """Make the type of a document: the fields of records, less some, and further keys with their meanings."""
    members: list[Field] = []
    said: dict[str, str] = {}
    for source in sources:
        kinds = get_type_hints(source)
        members += [(one.name, kinds[one.name]) for one in fields(source) if one.name not in {*leave, *more}]
        said |= attributes_said(source)
    members += [(key, kind) for key, (kind, _) in more.items()]
    SAID[called] = said | {key: text for key, (_, text) in more.items()}
    return msgspec.defstruct(called, members, forbid_unknown_fields=True, kw_only=True)


def _of_table(called: str, table: sa.Table, /, leave: tuple[str, ...] = (), **more: tuple[Any, str]) -> type:
    """Make the type of a table's row, its columns explained as in the store."""
    keys: dict[str, tuple[Any, str]] = {}
    for column in table.columns:
        if column.name not in {*leave, *more}:
            kind = _OF_COLUMN.get(type(column.type), int)
            keys[str(column.name)] = (
                kind | None if column.nullable and kind is not Any else kind,
                column.comment or "",
            )
    return _shape(called, **keys, **more)


_PICTURE = (str | None, "the picture that was written")
_FILES = (list[str], "what was written")
_CHANGE_IDS = (list[str], "the findings")
Finding = _of_table("Finding", schema.change, decision=(str, "open, accept, dismiss or defer"))
FindingExplained = _of_table(
    "FindingExplained", schema.change, leave=("terms",), decision=(str, "open, accept, dismiss or defer")
)
LogEntry = _of_table("LogEntry", schema.decision_log, evidence=(Evidence, "what the decision rested on"))
Gap = _shape(
    "Gap", first_ns=(int, "epoch, UTC"), last_ns=(int, "epoch, UTC"), seconds=(float, "how long it is")
)
Sensor = _shape(
    "Sensor",
    SensorSpan,
    leave=("epoch_ns",),
    gaps=(list[Gap], "steps longer than 2.5 usual ones, the first 100"),  # type: ignore[valid-type]
    first_ns=(int, "epoch of the first sample, UTC"),
    last_ns=(int, "epoch of the last sample, UTC"),
)
ComparedCamera = _shape("ComparedCamera", CameraCompared, sentence=(str, "the verdict for a person"))
LeftOut = _shape(
    "LeftOut",
    what=(str, "annotations, frames, …"),
    where=(str, "file or sensor"),
    reason=(str, "why"),
    count=(int, "how many"),
)
NoPicture = _shape(
    "NoPicture",
    change_id=(str, "the finding"),
    drive_id=(str, "the drive"),
    kind=(str, "what kind of reason"),
    sentence=(str, "the reason, in English"),
)
Layer = _shape("Layer", name=(str, ""), rows=(int, ""), what=(str, "what it shows"))
Camera = _shape(
    "Camera",
    CameraShare,
    range_min_m=(float | None, "of the sightings used, metres; null where none was"),
    range_max_m=(float | None, "likewise"),
    rms_px=(float | None, "of their residuals, of one axis; null where the method keeps none"),
)
_ErrorTold = _shape(
    "ErrorTold",
    code=(int, "exit code: twin help exit-codes"),
    kind=(str, "what kind of error: the code's name"),
    message=(str, "what, where and the cure: a sentence for a person"),
)
ErrorMessage = _shape("ErrorMessage", error=(_ErrorTold, "why the command ended"))
"""What stands on stderr in the place of a document."""
_DRIVE_KEYS = ("length_m", "is_matched", "n_findings", "n_open", "doubt")
DriveSet = _shape(
    "DriveSet",
    AnnotationSet,
    drive=(str, "the drive's name"),
    started=(str, "first epoch, UTC"),
    ended=(str, "last epoch, UTC"),
    objects=(dict[str, int], "method → objects that were located"),
    cost=(DriveCost | None, "with --cost"),
    **{key: (get_type_hints(DriveItem)[key], attributes_said(DriveItem)[key]) for key in _DRIVE_KEYS},
)

SettingsFile = _shape(
    "SettingsFile",
    what=(str, "whose settings it holds"),
    path=(str, "where it is looked for"),
    exists=(bool, "whether it is there"),
)
PasswordSet = _shape(
    "PasswordSet",
    variable=(str, "of the environment"),
    is_set=(bool, "whether it has a value"),
)

SHAPES: Mapping[str, Any] = {
    "sync-nvdb": SyncResult,
    "sync-nvdb --dry-run": SyncPlan,
    "ingest-drive": IngestReport,
    "drives": list[DriveSet],  # type: ignore[valid-type]
    "inspect": _shape(
        "Inspected",
        Inspection,
        skipped=(list[LeftOut], "what is left out"),  # type: ignore[valid-type]
        sensors=(list[Sensor], "GNSS or poses first, then frames and annotations by camera"),  # type: ignore[valid-type]
        picture=_PICTURE,
    ),
    "trajectory": _shape(
        "Trajectory",
        file=(str, "what was written"),
        poses=(int, "how many"),
        first_ns=(int, "epoch, UTC"),
        last_ns=(int, "epoch, UTC"),
        median=(dict[str, float], "sigma → its median: metres or degrees, as its name says"),
        warnings=(list[str], "sentences for a person"),
    ),
    "locate": _shape(
        "PixelPosition",
        PixelPosition,
        height_m=(float | None, "ellipsoidal, metres; null of --method paper, which gives none"),
        height_nn2000_m=(float | None, "NN2000, metres; null without HREF2018B"),
        covariance_m2=(list[list[float]], "grid east and grid north"),
    ),
    "match": _shape(
        "Matched",
        MatchReport,
        n_open=(int, "findings that somebody has to decide"),
        changes=(list[Finding], "every finding"),  # type: ignore[valid-type]
    ),
    "explain": _shape(
        "Explained",
        sentence=(str, "verdict, confidence, reason and decision, in English"),
        change=(FindingExplained, "the finding"),
        terms=(dict[str, Any] | None, "what verdict and confidence rest on: twin help matching"),
        drives=(list[DriveOfFinding], "that it rests on, in time order"),
        history=(list[LogEntry], "what was decided, oldest first"),  # type: ignore[valid-type]
    ),
    "decide": _shape("Decided", Decided, decided=(str, "accept, dismiss, defer or open")),
    "decide --dry-run": _shape("WouldDecide", Decided, would_decide=(str, "likewise")),
    "decide --from": _shape("FromQgis", change_ids=_CHANGE_IDS, **{"from": (str, "the GeoPackage")}),
    "decide undo": _shape("Undone", change_ids=_CHANGE_IDS, undone=(bool, "true")),
    "evidence --forget": Forgotten,
    "evidence": _shape(
        "Pictures",
        EvidenceReport,
        gaps=(list[NoPicture], "why pictures are missing"),  # type: ignore[valid-type]
    ),
    "export": _shape(
        "Exported",
        files=_FILES,
        method=(str, "of the positions: adjusted, single-frame or paper"),
        matched=(bool, "whether the store had findings; else only positions went out"),
        errors=(list[str], "why a change set cannot be sent, a sentence each"),
        left_out=(dict[str, str], "accepted finding → why it is in no change set"),
        unmasked_pictures=(int, "pictures of these findings that are not masked, and stay out"),
        sent_before=(dict[str, str | None], "finding → set at API Skriv that has it already"),
    ),
    "qgis": _shape(
        "Qgis",
        file=(str, "the GeoPackage"),
        project=(str | None, "how QGIS calls the project; null without one"),
        command=(list[str], "what opens it"),
        layers=(list[Layer], "the layers"),  # type: ignore[valid-type]
        decisions=(dict[str, int], "decision → findings"),
        decided_in_qgis=(dict[str, str], "finding → decision made there since the export"),
    ),
    "submit": _shape(
        "Sent",
        sent=(bool, "whether --go was given"),
        sets=(list[Submitted], "what became of each set"),
    ),
    "evaluate": _shape(
        "Evaluated",
        methods=(list[MethodResult], "errors by method"),
        groups=(list[GroupErrors], "the same by what `--by` names; empty without it"),
        warnings=(list[str], "what speaks against the survey, sentences for a person"),
        plots=_FILES,
        csv=(str | None, "the table that was written"),
    ),
    "reproduce": _shape("Reproduced", Reproduction, leave=("experiments", "files"), files=_FILES),
    "show": _shape(
        "Estimate",
        EstimateExplained,
        leave=("line_m", "misfits", "absence_gap"),
        finding=(Finding | None, "where a finding was asked for"),  # type: ignore[valid-type]
        height_m=(float | None, "ellipsoidal, metres; null where unknown"),
        sigma_height_m=(float | None, "one sigma, metres"),
        height_nn2000_m=(float | None, "NN2000, metres"),
        covariance_m2=(list[list[float]], "grid east and grid north"),
        frames=(list[dict[str, Any]], "each frame that it was seen in"),
        cameras=(list[Camera], "what each camera saw of it"),  # type: ignore[valid-type]
        corrections=(dict[str, Any], "what the drive's adjustment found; what speaks against the drive"),
        neighbours=(list[dict[str, Any]], "NVDB's signs within 15 m"),
        picture=_PICTURE,
    ),
    "show --frame": _shape("DrawnInto", pictures=(list[str], "the files that were written: picture, film")),
    "findings": FindingList,
    "config": _shape(
        "Config",
        files=(list[SettingsFile], "the upper stands above the lower"),  # type: ignore[valid-type]
        settings=(list[SettingInForce], "each key"),
        password=(PasswordSet, "of API Skriv; never shown"),
    ),
    "status": Status,
    "belief": BeliefList,
    "belief --next": RoadList,
    "confidence": _shape("Confidence", ConfidenceReport, picture=_PICTURE),
    "objects": ObjectsReport,
    "simulate": SimulateReport,
    "demo": _shape(
        "Demo",
        signs_synced=(dict[str, int], "skiltpunkt and skiltplate"),
        drives=(int, "drives read"),
        pictures=(int, "pictures painted"),
        crops=(int, "cut out of them"),
        sightings=(int, "annotated pixels"),
        estimates=(int, "objects with a position"),
        verdicts=(dict[str, int], "verdict → findings"),
        verdicts_expected=(dict[str, int], "verdict → how many the sample was made to hold"),
        median_error_m=(dict[str, float], "method → median error, metres"),
        coverage95=(dict[str, float], "method → share of truths inside their 95 % ellipses"),
        files=_FILES,
    ),
    "calibrate intrinsics": _shape(
        "Intrinsics",
        IntrinsicsReport,
        # The kinds of doubts are open: a package adds its own.
        faults=(list[dict[str, Any]], "what is wrong with the views"),
        files=_FILES,
    ),
    "calibrate example": _shape(
        "Example", board=(str, "for --board"), camera=(str, "its name"), files=_FILES
    ),
    "calibrate extrinsics": ExtrinsicsReport,
    "calibrate example-yard": _shape("ExampleYard", files=_FILES),
    "calibrate verify": _shape("Verified", Verification, leave=("errors_at",), plot=_PICTURE),
    "calibrate diff": _shape(
        "CalibrationDiff",
        cameras=(list[ComparedCamera], "each that both have"),  # type: ignore[valid-type]
        plot=_PICTURE,
    ),
    "calibrate coverage": _shape("Coverage", CoverageReport, plot=_PICTURE),
    "calibrate print-board": _shape("PrintedBoard", files=_FILES),
    "calibrate print-tags": _shape("PrintedTags", files=_FILES),
    "calibrate print-yard": _shape("PrintedYard", files=_FILES),
    "calibrate from-drives": _shape("FromDrives", Histories, plot=_PICTURE),
    "fleet ingest": Tally,
    "fleet ingest --queue": Added,
    "fleet work": Tally,
    "fleet status": _shape(
        "FleetStatus",
        drives=(dict[str, int], "waiting, running, done, parked → drives"),
        running=(list[Job], "drives that are being located"),
        parked=(list[Job], "jobs that wait for a person"),
    ),
    "fleet retry": _shape("Retried", waiting_again=(int, "jobs")),
    "store copy": StoreCopied,
    "store trim": Trimmed,
}
"""Command → type of its document."""


def schemas() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return command → JSON schema, and the types that these refer to, explained by their docstrings."""
    kinds = [*SHAPES.values(), ErrorMessage]
    found, parts = msgspec.json.schema_components(kinds, ref_template="#/$defs/{name}", schema_hook=_other)
    said = {one.__name__: attributes_said(one) for kind in kinds for one in _records(kind)} | SAID
    for name, part in parts.items():
        if about := part.pop("description", "").partition("\n")[0]:
            part["description"] = about
        for key, entry in part.get("properties", {}).items():
            if text := said.get(name, {}).get(key) or _SAME_EVERYWHERE.get(key):
                entry["description"] = text
    return dict(zip(SHAPES, found[:-1], strict=True)), parts


def _records(kind: Any) -> set[type]:
    """Every dataclass that a type is made of."""
    found = set().union(*(_records(part) for part in get_args(kind)))
    if isinstance(kind, type) and (is_dataclass(kind) or hasattr(kind, "__struct_fields__")):
        found |= {kind} if is_dataclass(kind) else set()
        found |= set().union(*(_records(part) for part in get_type_hints(kind).values()))
    return found


def _other(kind: type) -> dict[str, Any]:
    if issubclass(kind, Path):
        return {"type": "string"}
    raise TypeError(f"{kind.__name__} has no JSON Schema yet: say in _other what it is.")
