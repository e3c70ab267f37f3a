"""What changed between two versions of the datakatalog."""

from __future__ import annotations

from collections.abc import Iterator

from nvdb.datakatalog.katalog import Datakatalog, Egenskapstype


def diff(old: Datakatalog, new: Datakatalog) -> list[str]:
    """Say what changed between two versions, one sentence each; empty if nothing did.

    Values that only a partial list lacked are counted in one sentence a property instead of named.
    """
    found = (
        [] if old.version == new.version else [f"The datakatalog went from {old.version} to {new.version}."]
    )
    for number in sorted(old.egenskapstyper.keys() | new.egenskapstyper.keys()):
        before, after = old.egenskapstyper.get(number), new.egenskapstyper.get(number)
        if before is not None and after is not None:
            found.extend(_changes(before, after))
        elif after is not None:
            found.append(f"Egenskap {number} {after.navn!r} of type {after.type_id} is new.")
        elif before is not None:
            found.append(f"Egenskap {number} {before.navn!r} of type {before.type_id} is gone.")
    return found


def _changes(before: Egenskapstype, after: Egenskapstype) -> Iterator[str]:
    where = f"egenskap {after.id} {after.navn!r}"
    for what, was, now in (
        ("name", before.navn, after.navn),
        ("kind", before.egenskapstype, after.egenskapstype),
    ):
        if was and was != now:
            yield f"The {what} of {where} went from {was!r} to {now!r}."
    new = [enum_id for enum_id in after.verdier if enum_id not in before.verdier]
    if before.complete:
        yield from (f"Enum {enum_id} {after.verdier[enum_id]!r} of {where} is new." for enum_id in new)
    elif new:
        yield f"{len(new)} enum values of {where} are known now that the older list lacked."
    if after.complete:
        gone = [enum_id for enum_id in before.verdier if enum_id not in after.verdier]
        yield from (f"Enum {enum_id} {before.verdier[enum_id]!r} of {where} is gone." for enum_id in gone)
    for enum_id, old in before.verdier.items():
        value = after.verdier.get(enum_id, old)
        # A partial list knows some signs by their code alone: a description added to it is no change.
        if str(value) != str(old) and (before.complete or not str(value).startswith(f"{old} ")):
            yield f"Enum {enum_id} of {where} was {old!r} and is {value!r}."
