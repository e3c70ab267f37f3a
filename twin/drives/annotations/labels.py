"""What a label means: sign codes, another road object, or nothing for twin.

``labels.toml`` in the drive folder::

    foot_keypoints = ["fundament"]           # further names of key points that are the foot
    [labels]
    "Speed 50" = "362.50"
    "speed and hump" = ["362.50", "808.105"] # several plates, top down
    "guard rail end" = { type = 14 }         # another NVDB type: located and exported, not compared with NVDB
    "kerb" = { type = 9, ground = true }     # lies on the ground: `twin objects` locates it
    "hole" = { ground = true }               # the same, of no NVDB type
    "object--vehicle--*" = "ignore"

Case, blanks, ``-`` and ``_`` do not matter; ``*`` stands for anything. A name without ``*`` comes before
one with, and of those the longest. After the drive's own come the labels of :data:`DEFAULT`, which ships
with twin.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any

from nvdb.datakatalog import SKILTNUMMER, sign_code, snapshot
from twin.drives.folder.keys import LABEL_KEYS
from twin.errors import DriveError

LABELS_FILE = "labels.toml"
DEFAULT = "labels_default.toml"
IGNORE = "ignore"
_SIGN_TYPES = (95, 96)
_HIGHEST_TYPE = 9999


@dataclass(frozen=True, slots=True)
class Meaning:
    """What one label stands for.

    Attributes
    ----------
    codes : str
        Norwegian sign codes, top down, joined by ``;``; "" for what is no sign.
    nvdb_type : int or None
        Vegobjekttype of an object that is no sign.
    is_ignored : bool
        Whether it is no road object at all.
    is_on_ground : bool
        Whether it lies on the ground, drawn as a point, line or polygon, and is never read as a sign.
    """

    codes: str = ""
    nvdb_type: int | None = None
    is_ignored: bool = False
    is_on_ground: bool = False


@dataclass(frozen=True, slots=True)
class LabelMap:
    """Labels and what they mean.

    Attributes
    ----------
    exact : mapping of label, as `plain_label` spells it, to meaning
    patterns : tuple of (pieces, meaning)
        What stands between the ``*`` of each pattern; longest first.
    foot_keypoints : tuple of str
    """

    exact: Mapping[str, Meaning] = field(default_factory=dict)
    patterns: tuple[tuple[tuple[str, ...], Meaning], ...] = ()
    foot_keypoints: tuple[str, ...] = ()

    def codes(self) -> list[str]:
        """Return every sign code of the map once, sorted."""
        meanings = [*self.exact.values(), *(meaning for _, meaning in self.patterns)]
        return sorted({code for meaning in meanings for code in meaning.codes.split(";") if code})

    def of(self, label: str) -> Meaning | None:
        """Return what a label means; None if the map does not say."""
        plain = plain_label(label)
        if plain in self.exact:
            return self.exact[plain]
        return next((meaning for pieces, meaning in self.patterns if _matches(pieces, plain)), None)

    def is_on_ground(self, label: str) -> bool:
        """Whether a label is of what lies on the ground."""
        meaning = self.of(label)
        return meaning is not None and meaning.is_on_ground


class Meanings:
    """Says what the labels of one drive mean, and remembers which were asked for.

    Parameters
    ----------
    own : LabelMap or None
        The drive's own.

    Attributes
    ----------
    unmapped : Counter of str
        How often a label was asked for that says no sign code and no type.
    """

    def __init__(self, own: LabelMap | None) -> None:
        self._own = own or LabelMap()
        self._known: dict[str, Meaning | None] = {}
        self.unmapped: Counter[str] = Counter()

    def of(self, label: str, skiltnummer: str) -> Meaning:
        """Return the meaning of a label beside the codes of the attribute ``skiltnummer``."""
        if label not in self._known:
            self._known[label] = self._look_up(label)
        meaning = self._known[label]
        if skiltnummer and not (meaning and meaning.is_on_ground):
            return Meaning(skiltnummer)
        if meaning is None:
            self.unmapped[label] += 1
        return meaning or Meaning()

    def other_objects(self) -> dict[str, int]:
        """Labels of objects that are no signs."""
        return {
            label: meaning.nvdb_type
            for label, meaning in self._known.items()
            if meaning is not None and meaning.nvdb_type is not None
        }

    def _look_up(self, label: str) -> Meaning | None:
        meaning = self._own.of(label)
        if meaning is None and codes_from_label(label):
            return Meaning(codes_from_label(label))
        return meaning or default_label_map().of(label)


def plain_label(label: str) -> str:
    """Spell a label so that ways of writing it compare: lower case, one blank for blanks, ``-`` and ``_``."""
    return re.sub(r"[\s_\-]+", " ", label[:500].casefold()).strip()


def read_label_map(content: bytes, where: str = LABELS_FILE) -> LabelMap:
    """Read a ``labels.toml``.

    Raises
    ------
    DriveError
        If it is not TOML, or a label is mapped to what is no sign code and no type.
    """
    document = _document(content, where)
    unknown = sorted(set(document) - set(LABEL_KEYS))
    if unknown:
        raise DriveError(f"{where} has the unknown key {unknown[0]:.60}: labels belong under [labels].")
    feet = document.get("foot_keypoints", [])
    if not isinstance(feet, list) or not all(isinstance(name, str) for name in feet):
        raise DriveError(f"{where} gives foot_keypoints = {feet!r:.60}: it must be a list of names.")
    labels = document.get("labels", {})
    if not isinstance(labels, dict):
        raise DriveError(f"{where} gives labels = {labels!r:.60}: it must be a table, [labels].")
    exact, patterns = {}, []
    for label, value in labels.items():
        plain, meaning = plain_label(label), _meaning(label, value, where)
        if "*" in plain:
            patterns.append((tuple(re.split(r"\*+", plain)), meaning))
        else:
            exact[plain] = meaning
    patterns.sort(key=lambda one: -sum(map(len, one[0])))
    return LabelMap(exact, tuple(patterns), tuple(feet))


def _matches(pieces: tuple[str, ...], text: str) -> bool:
    """Whether the pieces stand in the text in this order, the first at its beginning, the last at its end."""
    first, *middle, last = pieces
    at, end = len(first), len(text) - len(last)
    if at > end or not text.startswith(first) or not text.endswith(last):
        return False
    for piece in middle:
        start = text.find(piece, at, end)
        if start < 0:
            return False
        at = start + len(piece)
    return True


@cache
def default_label_map() -> LabelMap:
    """Return the labels that ship with twin: those of Mapillary and of common European data sets."""
    return read_label_map(files("twin.drives.annotations").joinpath(DEFAULT).read_bytes(), DEFAULT)


def _document(content: bytes, where: str) -> dict[str, Any]:
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise DriveError(f"{where} is not UTF-8 text: save it as UTF-8.") from error
    except (tomllib.TOMLDecodeError, ValueError, RecursionError) as error:
        raise DriveError(f"{where} is not valid TOML ({error}): correct that line.") from error


def _meaning(label: str, value: object, where: str) -> Meaning:
    if value == IGNORE:
        return Meaning(is_ignored=True)
    if isinstance(value, dict) and value and set(value) <= {"type", "ground"}:
        number = _type(label, value["type"], where) if "type" in value else None
        ground = value.get("ground", False)
        if isinstance(ground, bool) and (ground or number is not None):
            return Meaning(nvdb_type=number, is_on_ground=ground)
    given = [value] if isinstance(value, str) else value
    if isinstance(given, list) and given and all(isinstance(one, str) for one in given):
        codes = [codes_from_attribute(one) for one in given]
        if all(codes):
            return Meaning(";".join(codes))
    raise DriveError(
        f'{where} maps {label!r:.60} to {value!r:.60}: write a sign code ("362.50"), a list of them, '
        f'{{ type = 14 }} for another NVDB type, {{ type = 9, ground = true }} on the ground, or "{IGNORE}".'
    )


def _type(label: str, value: object, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 < value <= _HIGHEST_TYPE:
        raise DriveError(
            f"{where} gives {label!r:.60} the type {value!r:.20}: it must be an NVDB type, such as 14."
        )
    if value in _SIGN_TYPES:
        raise DriveError(
            f"{where} gives {label!r:.60} the type {value}: that is a sign, so write its sign code."
        )
    return value


# A code of the sign regulation (skiltforskriften) as the vegobjekt skiltplate spells it: "202", "362.50",
# "906H", "727.3K", and the retired "U324". It ends where no further letter, digit or part follows, so that
# a year, a house number or a cut word is not read as a code.
_CODE = r"U?\d{3}[A-ZÆØÅ]?(?:\.[0-9A-ZÆØÅ]+)*(?![0-9A-Za-zÆØÅæøå]|\.[0-9A-Za-zÆØÅæøå])"


_AT_START = re.compile(rf"\s*(?:(?:skilt|sign)(?:nummer|plate)?[\s_:\-]*)?({_CODE})", re.IGNORECASE)


_CASED = re.compile(_CODE)


# "362,50": the decimal comma of a Norwegian keyboard. Two codes in a list never look like it, since the
# second has three digits.
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d{1,2}(?!\d))")


_BETWEEN_CODES = re.compile(r"[;|+\n]|,")


@lru_cache(maxsize=1024)
def codes_from_attribute(text: str) -> str:
    """Sign codes of the attribute ``skiltnummer``, top down, joined by ``;``.

    Parameters
    ----------
    text : str
        As annotators write it: ``362.50``, ``362.50;808.1``, ``362,50 Fartsgrense``, ``906h``.

    Returns
    -------
    str
        "362.50;808.1"; "" where there is no code in it.
    """
    parts = _BETWEEN_CODES.split(_DECIMAL_COMMA.sub(".", text))
    matches = (_AT_START.match(part) for part in parts)
    return ";".join(match.group(1).upper() for match in matches if match)


def codes_from_label(label: str) -> str:
    """Sign codes of a label that begins with one: ``362.50 Fartsgrense``, ``skilt_906H``, ``362.50;808``.

    Returns
    -------
    str
        The codes joined by ``;``, "" where the label does not begin with one. Letters count only in
        capitals: ``100m`` is a distance, not a sign.
    """
    codes = []
    for part in label.split(";"):
        match = _AT_START.match(part)
        if not match or not _CASED.fullmatch(match.group(1)):
            break
        codes.append(match.group(1))
    return ";".join(codes)


_MOST_CODES = 8


def unknown_codes_warning(labels: LabelMap, where: str) -> list[str]:
    """List the codes that twin does not know, each with the nearest that it knows; empty if there are none.

    The datakatalog's snapshot holds the common signs only: an unknown code may well be right.
    """
    shipped = known_codes()
    unknown = [code for code in labels.codes() if code not in shipped]
    if not unknown:
        return []
    listed = [f"{code} (nearest: {_nearest(code)})" for code in unknown[:_MOST_CODES]]
    more = f" and {len(unknown) - _MOST_CODES} more" if len(unknown) > _MOST_CODES else ""
    warning = (
        f"{where} uses sign codes that are not among the {len(shipped)} that ship with twin:"
        f" {', '.join(listed)}{more}. They are taken as written; check that NVDB has them."
    )
    return [warning]


@cache
def known_codes() -> frozenset[str]:
    """Sign codes of the datakatalog's snapshot, and those of the labels that ship with twin."""
    values = snapshot().egenskapstyper[SKILTNUMMER].verdier.values()
    codes = {code for value in values if (code := sign_code(str(value))) is not None}
    return frozenset(codes | set(default_label_map().codes()))


def _nearest(code: str) -> str:
    return difflib.get_close_matches(code, sorted(known_codes()), n=1, cutoff=0.0)[0]
