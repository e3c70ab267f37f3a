"""What drives read on the plates of one pole: each reading is a vote that may be wrong, the order counts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from nvdb.datakatalog import sign_family
from twin.matching.config import MatchConfig
from twin.matching.plates.wording import normalised

_NS_PER_YEAR = 365.25 * 86_400e9


class Reader(NamedTuple):
    """One drive that read the plates of a pole; `seen_from_deg` as of the pole."""

    drive_id: str
    epoch_ns: int
    seen_from_deg: frozenset[float]


class PlateReading(NamedTuple):
    """One drive's word on one plate; `seen_from_deg` as in :class:`twin.matching.poles.poles.ObservedPole`.

    `text` is what is written on it, "" where that was not annotated.
    """

    code: str
    drive_id: str
    epoch_ns: int
    seen_from_deg: frozenset[float] = frozenset()
    text: str = ""


PlateHistory = tuple[PlateReading, ...]
"""The readings of one plate, in time order of the drives; one a drive, two where its cameras disagree."""


def together(a: Sequence[PlateHistory], b: Sequence[PlateHistory]) -> tuple[PlateHistory, ...]:
    """Join what earlier and later observers read on one pole, plate by plate.

    Plates that were read alike are the same, and of those rather the ones with the same text; then plates of
    one family; then any two, in their order: a plate that was exchanged or misread. Plates that were seen
    from opposite sides are the same only if they read alike. What is left was read by one side alone. The
    side with more plates gives the order.
    """
    same = [x[-1].code for x in a] == [y[-1].code for y in b]
    if same and not any(map(_other_text, a, b)):  # nearly always
        return tuple([_votes(x, y) for x, y in zip(a, b, strict=True)])
    partner = dict(_pairs(a, b))
    of_b = {j: i for i, j in partner.items()}
    if len(b) > len(a):
        joined = [_votes(a[of_b[j]], plate) if j in of_b else plate for j, plate in enumerate(b)]
        return (*joined, *(plate for i, plate in enumerate(a) if i not in partner))
    joined = [_votes(plate, b[partner[i]]) if i in partner else plate for i, plate in enumerate(a)]
    return (*joined, *(plate for j, plate in enumerate(b) if j not in of_b))


def _pairs(a: Sequence[PlateHistory], b: Sequence[PlateHistory]) -> Iterator[tuple[int, int]]:
    left, right = list(range(len(a))), list(range(len(b)))
    for alike in (_same_text, _read_alike, _of_one_family, _from_one_side):
        for i in list(left):
            j = next((j for j in right if alike(a[i], b[j])), None)
            if j is not None:
                left.remove(i)
                right.remove(j)
                yield i, j


def _same_text(x: PlateHistory, y: PlateHistory) -> bool:
    text = normalised(text_now(x))
    return bool(text) and text == normalised(text_now(y)) and _read_alike(x, y)


def _other_text(x: PlateHistory, y: PlateHistory) -> bool:
    """Whether both have a text, and not the same."""
    one, other = normalised(text_now(x)), normalised(text_now(y))
    return bool(one) and bool(other) and one != other


def _read_alike(x: PlateHistory, y: PlateHistory) -> bool:
    return not {r.code for r in x}.isdisjoint(r.code for r in y)


def _of_one_family(x: PlateHistory, y: PlateHistory) -> bool:
    return family(x[-1].code) == family(y[-1].code) and _from_one_side(x, y)


def _from_one_side(x: PlateHistory, y: PlateHistory) -> bool:
    """Whether both may have been read from one side: some directions lie within 90°, or are not known."""
    return any(
        not one.seen_from_deg
        or not other.seen_from_deg
        or any(math.cos(math.radians(p - q)) >= 0 for p in one.seen_from_deg for q in other.seen_from_deg)
        for one in x
        for other in y
    )


def _votes(x: PlateHistory, y: PlateHistory) -> PlateHistory:
    """Readings of both; what cameras of one drive read alike is one vote: one annotator, one slip."""
    if x[-1].drive_id != y[0].drive_id:
        return x + y
    known = {(r.drive_id, r.code) for r in x}
    said = {(r.drive_id, r.code): r.text for r in y if r.text}
    if said:  # the one vote has the text that either camera showed
        x = tuple(r if r.text else r._replace(text=said.get((r.drive_id, r.code), "")) for r in x)
    return (*x, *(r for r in y if (r.drive_id, r.code) not in known))


def text_now(plate: PlateHistory) -> str:
    """Text that was read last; "" where none was."""
    return next((reading.text for reading in reversed(plate) if reading.text), "")


def is_disputed(plate: PlateHistory) -> bool:
    """Whether a plate was read in more than one way."""
    return len({reading.code for reading in plate}) > 1


def code_now(plate: PlateHistory, config: MatchConfig) -> str:
    """The likeliest code by the readings alone; of equals the latest read."""
    if not is_disputed(plate):
        return plate[-1].code
    chance = code_chances(plate, None, config)
    last = {reading.code: number for number, reading in enumerate(plate)}
    return max(chance, key=lambda code: (round(chance[code], 12), last[code]))


def code_chances(plate: PlateHistory, known: str | None, config: MatchConfig) -> dict[str, float]:
    """Probability of each code that a plate may carry now: the codes that were read, and NVDB's.

    A hidden Markov model over the readings in time order (Rabiner 1989, the forward algorithm). Before the
    first reading the plate carries NVDB's code but for `MatchConfig.p_code_wrong`. Between two readings it is
    exchanged at `exchanged_per_year`. A reading is wrong with `p_misread`. Which other code then comes is the
    same chance in all three: of its own family likelier than of another. So 50, 50, 60, 60 is an exchange,
    and 50, 60, 50, 50 a slip.

    Parameters
    ----------
    plate : readings, at least one
    known : str or None
        NVDB's code; None or "" where it has none: then every code read is alike before the first reading.

    Returns
    -------
    dict
        Code → probability; they sum to 1.
    """
    codes = sorted({reading.code for reading in plate} | ({known} if known else set()))
    if len(codes) == 1:
        return {codes[0]: 1.0}
    if known:
        chance = {c: _turned(1 - config.p_code_wrong, config.p_code_wrong, known, c, config) for c in codes}
    else:
        chance = dict.fromkeys(codes, 1.0)
    before: PlateReading | None = None
    for reading in sorted(plate, key=lambda r: r.epoch_ns):
        if before is not None:
            years = (reading.epoch_ns - before.epoch_ns) / _NS_PER_YEAR
            stays = math.exp(-config.exchanged_per_year * years)
            chance = {
                c: sum(chance[o] * _turned(stays, 1 - stays, o, c, config) for o in codes) for c in codes
            }
        for c in codes:
            chance[c] *= _turned(1 - config.p_misread, config.p_misread, c, reading.code, config)
        total = math.fsum(chance.values())
        chance = {c: p / total for c, p in chance.items()} if total else dict.fromkeys(codes, 1 / len(codes))
        before = reading
    return chance


def _turned(p_same: float, p_other: float, code: str, into: str, config: MatchConfig) -> float:
    """Chance that a code stays, or becomes a given other one."""
    if code == into:
        return p_same
    return p_other * (config.p_of_family if family(code) == family(into) else config.p_of_another_family)


def family(code: str) -> str:
    """``"362"`` for ``"362.50"``; retired ``U…`` codes belong to the family they retired from."""
    return sign_family(code).removeprefix("U")
