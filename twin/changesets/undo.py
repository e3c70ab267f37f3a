"""The set that undoes another, made when that was carried out: only then its ids and its time are known."""

from __future__ import annotations

from dataclasses import replace

from nvdb.datakatalog import snapshot
from nvdb.endringssett import Earlier, Egenskap, inverse, to_xml
from nvdb.errors import RequestError
from nvdb.objects import point_from_wkt
from nvdb.skriv import EndringssettStatus
from twin.changesets.nvdb_side import earlier_from_raw, name
from twin.changesets.read_exported import ExportedSet
from twin.store.atomic_files import replace_file


def write_undo(found: ExportedSet, status: EndringssettStatus) -> tuple[str | None, tuple[str, ...]]:
    """Write ``endringssett-1-angre-….xml`` beside a set that was carried out.

    Parameters
    ----------
    found : ExportedSet
    status : EndringssettStatus
        Of the set, accepted.

    Returns
    -------
    file : str or None
        Its name; None where it cannot be made.
    sentences : tuple of str
        Why not, or what it does not bring back.
    """
    if found.before is None or status.transaksjon_tid is None:
        return None, ("There is no set to undo it: the state before it is not known.",)
    said: list[str] = []
    try:
        states = [_writable(earlier_from_raw(raw, None, snapshot()), said) for raw in found.before]
        back = inverse(found.sett, states, nvdb_ids=status.nvdb_ids, lest_fra_nvdb=status.transaksjon_tid)
    except RequestError as error:
        return None, (f"There is no set to undo it: {error}",)
    path = found.path.with_name(f"{found.path.stem}-angre-{(status.set_id or '')[:8]}.xml")
    replace_file(path, to_xml(back))
    touched = {
        name(e.type_id, e.nvdb_id)
        for e in back.endringer
        if e.nvdb_id is not None and any(item.geometri is not None for item in e.egenskaper)
    }
    return path.name, tuple(
        f"Undoing brings {who} back without its height: NVDB has no quality for that, and takes none without."
        for who in said
        if who in touched
    )


def _writable(state: Earlier, without_height: list[str]) -> Earlier:
    """Take a height away that has no quality: NVDB holds such, API Skriv refuses them."""
    egenskaper = tuple(_in_plan(item) for item in state.egenskaper)
    if egenskaper != state.egenskaper:
        without_height.append(name(state.type_id, state.nvdb_id))
    return replace(state, egenskaper=egenskaper)


def _in_plan(item: Egenskap) -> Egenskap:
    geometri = item.geometri
    if geometri is None or geometri.kvalitet is None:
        return item
    east, north, height = point_from_wkt(geometri.wkt)
    quality = (geometri.kvalitet.datafangstmetode_hoyde, geometri.kvalitet.noyaktighet_hoyde_cm)
    if height is None or None not in quality:
        return item
    kvalitet = replace(geometri.kvalitet, datafangstmetode_hoyde=None, noyaktighet_hoyde_cm=None)
    return replace(item, geometri=replace(geometri, wkt=f"POINT ({east!r} {north!r})", kvalitet=kvalitet))
