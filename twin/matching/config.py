"""What matching assumes, in one frozen object."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path

from twin.errors import ConfigError, FileError


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
    """Sigma of an object that NVDB only places on the road's centre line, where the road is not known."""
    along_road_sigma_m: float = 3.0
    """Sigma along the road of such an object, where the road network is known."""
    verge_m: float = 15.0
    """How far beside the centre line such an object may stand, where the road network is known."""
    p_other_side: float = 0.05
    """Chance that NVDB has such an object on the wrong side of the road."""
    p_behind: float = 0.05
    """Chance that a plate was read though NVDB says that it faces away from every camera."""
    own_share: float = 0.8
    """Share of a position's variance that is the drive's own (satellites, clock, pixels), so that it falls
    over several drives; the rest (lever arm, boresight, slope, kerb) is the same in all of them."""
    p_moved: float = 0.03
    """Prior share of signs that no longer stand where NVDB has them."""
    p_gone: float = 0.02
    """Prior share of signs that are gone."""
    p_missed: float = 0.002
    """Chance that an annotator who declares a drive complete still overlooked a pole in view."""
    p_hidden: float = 0.001
    """Chance that a pole counts as in view and is hidden in every drive all the same: a hedge, a wall."""
    p_unseen: float = 0.5
    """Chance that a pole goes unannotated in a drive not declared complete, or in view in few pictures."""
    removed_per_year: float = 0.02
    """Share of signs that are taken down in a year: how soon a pole that was seen may be gone."""
    new_per_m2: float = 5e-5
    """Density of signs that NVDB does not have, near the road."""
    p_code: float = 0.05
    """Chance that any one sign carries a given common code."""
    p_code_wrong: float = 0.02
    """Chance that a plate carries another code than NVDB says: as many as are exchanged in a year, which is
    about how long NVDB takes to follow."""
    p_misread: float = 0.01
    """Chance that a drive's annotator gives a plate another code than it carries."""
    exchanged_per_year: float = 0.02
    """Share of plates that get another code in a year: a new speed limit, a new rule."""
    p_of_family: float = 0.5
    """Chance that what was exchanged, misread or registered wrongly is a given code of its own family
    (362.50 for 362.60): families have few members, and members look alike."""
    p_of_another_family: float = 0.005
    """The same for a given code of another family."""
    p_text_other: float = 0.05
    """Chance that a plate carries quite another text than NVDB says: exchanged, or registered wrongly."""
    p_text_misspelt: float = 0.1
    """Chance that its text is spelt otherwise: annotators misspell, NVDB abbreviates."""
    p_text_by_chance: float = 0.05
    """Chance that another plate of the same code carries the same text; as likely is one merely alike."""
    text_alike: float = 0.75
    """Texts that are at least so alike, from 0 to 1, are one text spelt in two ways."""
    p_plate_extra: float = 0.02
    """Chance that a pole carries one plate more than NVDB knows."""
    p_plate_unread: float = 0.1
    """Chance that a plate of NVDB's was not read on a pole that was seen: it faces away, or is gone."""
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
    seen_twice_m: float = 3.0
    """Objects of one drive with the same plates, never marked in one picture, are one pole within this
    distance, if the measurement cannot tell their places apart."""
    map_aided: bool = False
    """Whether signs that NVDB has measured well tie drives to the ground, where they agree."""
    measured_m: float = 0.1
    """Stated accuracy down to which a sign of NVDB counts as measured well."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise ConfigError(
                    f"The setting {field.name} of matching is {value}: give a number of at least 0."
                )
            if value > 1 and (field.name.startswith("p_") or field.name in _SHARES):
                raise ConfigError(
                    f"The setting {field.name} of matching is {value}: give a share of at most 1."
                )


_SHARES = frozenset({"own_share", "review_below", "text_alike"})


def settings_from(path: Path) -> MatchConfig:
    """Read settings of matching from the table ``[matching]`` of a TOML file; the others keep their values.

    Raises
    ------
    FileError
        It cannot be read.
    ConfigError
        It has no such table, or a setting in it is unknown or none that there can be.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8")).get("matching")
    except OSError as error:
        told = f"The settings {path} cannot be read ({error.strerror}): name a TOML file."
        raise FileError(told) from error
    except ValueError as error:
        raise ConfigError(f"The settings {path} are no TOML ({error}): mend that line.") from error
    if not isinstance(table, dict):
        raise ConfigError(f"The settings {path} have no table [matching]: put the settings below that line.")
    kinds = {field.name: type(field.default) for field in fields(MatchConfig)}
    for name, value in table.items():
        if kinds.get(name, bool) is bool:
            raise ConfigError(f"The settings {path} name {name!r}, which matching does not have: correct it.")
        if isinstance(value, bool) or not isinstance(value, (int, kinds[name])):
            number = "a whole number" if kinds[name] is int else "a number"
            raise ConfigError(f"The settings {path} give {name} as {value!r}: give {number}.")
    return MatchConfig(**table)
