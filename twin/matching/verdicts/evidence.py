"""What findings carry beside their verdicts: doubts of drives, covariances and cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from geoloc.arrays import FloatArray
from twin.matching.drives import Drive
from twin.matching.poles.poles import ObservedPole
from twin.matching.verdicts.finding import doubtful_as_review
from twin.store.records import Finding


def with_evidence(
    findings: Sequence[Finding], poles: Sequence[ObservedPole], drives: Sequence[Drive]
) -> list[Finding]:
    """Put drives that are not trusted up for review, and add covariances and cameras."""
    doubted = doubtful_as_review(
        findings, {drive.drive_id: drive.doubt for drive in drives if drive.doubt is not None}
    )
    measured = {(pole.east_m, pole.north_m): pole.covariance_m2 for pole in poles}
    watched = _Cameras.of(poles, drives)
    return [
        replace(finding, covariance_m2=_covariance(finding, measured), cameras=watched.for_finding(finding))
        for finding in doubted
    ]


@dataclass(frozen=True, slots=True)
class _Cameras:
    """Cameras that saw each pole, by its key, and those of each drive that were annotated."""

    of_pole: Mapping[str, frozenset[str]]
    of_drive: Mapping[str, tuple[str, ...]]

    @classmethod
    def of(cls, poles: Sequence[ObservedPole], drives: Sequence[Drive]) -> _Cameras:
        return cls({pole.key: pole.cameras for pole in poles}, {d.drive_id: d.cameras for d in drives})

    def for_finding(self, finding: Finding) -> tuple[str, ...]:
        """Their names; of a sign that was not seen, the cameras of the drives that looked for it."""
        of_pole = self.of_pole.get(finding.terms.get("pole", ""))
        if of_pole is not None:
            names = {camera.partition("/")[2] for camera in of_pole}
        else:
            names = {name for drive in finding.drive_ids for name in self.of_drive.get(drive, ())}
        return tuple(sorted(names))


def _covariance(
    finding: Finding, measured: Mapping[tuple[float, float], FloatArray]
) -> tuple[float, float, float] | None:
    """Covariance of the measured position; None where a finding stands at NVDB's position."""
    covariance_m2 = measured.get((finding.east_m, finding.north_m))
    if covariance_m2 is None:
        return None
    (ee, en), (_, nn) = covariance_m2.tolist()
    return ee, en, nn
