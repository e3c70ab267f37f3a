"""What matching assumes, in one frozen object."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from twin.errors import ConfigError


@dataclass(frozen=True, slots=True)
class MatchConfig:
    """Gates, priors and tolerances of matching. Every value can be overridden; none is hidden elsewhere."""

    gate_m: float = 15.0
    """A pole further from NVDB's position than this is never paired with it."""
    tolerance_m: float = 1.0
    """NVDB's own requirement for sign positions since 2015: further away means ``moved``."""
    moved_quantile: float = 1.645
    """Sigmas by which the distance must exceed the tolerance: 95 % one-sided certainty."""
    default_accuracy_m: float = 1.0
    """Sigma for NVDB positions that state none, or the default-looking 100 cm / ``ukj``."""
    centre_line_sigma_m: float = 8.0
    """Sigma of an object that NVDB only places on the road's centre line."""
    p_moved: float = 0.03
    """Prior share of signs that no longer stand where NVDB has them."""
    p_gone: float = 0.02
    """Prior share of signs that are gone."""
    p_missed: float = 0.002
    """Chance that an annotator who declares a drive complete still overlooked a pole in view."""
    p_unseen: float = 0.5
    """Chance that a pole goes unannotated in a drive that is not declared complete."""
    new_per_m2: float = 5e-5
    """Density of signs that NVDB does not have, near the road."""
    p_code: float = 0.05
    """Chance that any one sign carries a given common code."""
    p_code_wrong: float = 0.03
    """Chance that a sign has changed, or was misread: that it carries another code than NVDB says."""
    p_code_family: float = 0.01
    """Chance that a sign now carries a given other code of its family (362.50 for 362.60)."""
    p_code_other: float = 0.00015
    """The same for a given code of another family."""
    mirrored_m: float = 1000.0
    """A pole that has no sign of NVDB within this distance may stand outside the mirrored area."""
    review_below: float = 0.8
    """A finding whose best hypothesis has less posterior probability than this goes to ``review``."""
    min_views: int = 5
    """Frames in which a pole's place must have been in view before it can be missing."""
    view_range_m: float = 20.0
    """How far away a pole counts as in view."""
    same_pole_m: float = 0.4
    """Objects of one drive and camera closer than this share a pole: plates annotated one by one."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise ConfigError(
                    f"The setting {field.name} of matching is {value}: give a number of at least 0."
                )
