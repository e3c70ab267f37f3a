"""A change set in the form of Datafangst, for contractors who may not write to NVDB themselves.

Datafangst takes road objects from the members of a contract; the road authority's data managers check them,
hang plates on their Skiltpunkt and send them on to NVDB. Its GeoJSON says less than a change set: no place on
the road network (Datafangst finds it by itself), no dates of validity and no relation between objects. The
dates and the relation stand in the comment instead, for the data manager.

Source: *Datafangst-API*, section *Format*, https://apiskriv.vegdata.no/datafangst/datafangst-api (repository
nvdb-vegdata/apiskrivdokumentasjon, datafangst/datafangst-api.md). It documents Datafangst 1.0; a published
script uploads the same form to Datafangst 2.0 (repository LtGlahn/datafangst, df20.py). Its numeric
``measurementMethod`` has no documented value for NVDB's ``fot``, so it is left out and said in the comment.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from geoloc.earth.geodesy import geographic_from_utm33
from nvdb.datakatalog import snapshot
from nvdb.endringssett import Earlier, Endring, Geometri
from nvdb.objects import point_from_wkt
from twin.changesets.build import ChangeSets, Sett
from twin.changesets.nvdb_side import earlier_from_raw, name
from twin.matching.sites import SKILTPLATE, SKILTPUNKT

OPERATION: Final = {
    "delvisOppdater": "UPDATE",
    "delvisKorriger": "CORRECT",
    "lukk": "CLOSE",
}
"""What our change sets do → Datafangst's word; a new object carries none."""
_DECIMALS = 8
"""About a millimetre, as in the examples of the documentation."""


def datafangst(made: ChangeSets, sett: Sett) -> bytes:
    """Write a set as a FeatureCollection: a feature for each object, in longitude and latitude.

    Heights are NN2000, which Datafangst takes for granted. The plates of a closed Skiltpunkt are closed by a
    feature of their own, since Datafangst is not said to close them along.
    """
    states = {
        (state.type_id, state.nvdb_id): state
        for state in (earlier_from_raw(raw, None, snapshot()) for raw in sett.before)
    }
    parents = {
        datter.temp_id: _tag(endring)
        for endring in sett.sett.endringer
        for assosiasjon in endring.assosiasjoner
        for datter in assosiasjon.dotre
        if datter.temp_id is not None
    }
    features = [
        feature
        for group in sett.groups
        for endring in group.endringer
        for feature in _features(
            endring,
            {"dataCatalogVersion": sett.sett.datakatalogversjon},
            [*_remarks(endring, parents.get(endring.temp_id or "")), _reasons(made, group.change_ids)],
            states,
        )
    ]
    lines = ",\n".join(json.dumps(feature, ensure_ascii=False) for feature in features)
    return f'{{"type": "FeatureCollection", "features": [\n{lines}\n]}}\n'.encode()


def _reasons(made: ChangeSets, change_ids: tuple[str, ...]) -> str:
    return " ".join(f"twin {key}: {made.findings[key].reason}" for key in change_ids)


def _features(
    endring: Endring,
    common: Mapping[str, Any],
    remarks: Sequence[str],
    states: Mapping[tuple[int, int], Earlier],
) -> Iterator[dict[str, Any]]:
    """Give the feature of an object, and of the plates that a closing takes along."""
    properties: dict[str, Any] = {
        "tag": _tag(endring),
        **common,
        "typeId": endring.type_id,
        **_known(endring.operasjon, endring.nvdb_id, endring.versjon),
        "comment": " ".join(remarks),
    }
    feature: dict[str, Any] = {"type": "Feature", "properties": properties}
    attributes = {str(e.type_id): _value(e.enum or e.verdi) for e in endring.egenskaper if e.geometri is None}
    if attributes or endring.nvdb_id is None:
        # A new object has to say so even where it has none.
        properties["attributes"] = attributes
    geometri = next((e.geometri for e in endring.egenskaper if e.geometri is not None), None)
    if geometri is not None:
        feature["geometry"] = _point(geometri)
        properties["geometryAttributes"] = _quality(geometri)
    yield feature
    state = states.get((endring.type_id, endring.nvdb_id or 0))
    if endring.kaskade and state is not None:
        for number in (child for ids in (state.dotre or {}).values() for child in ids):
            if (plate := states.get((SKILTPLATE, number))) is not None:
                own = {"tag": name(SKILTPLATE, number), "typeId": SKILTPLATE}
                known = _known("lukk", number, plate.versjon)
                comment = f"Closed with {name(endring.type_id, state.nvdb_id)}. {properties['comment']}"
                yield {"type": "Feature", "properties": {**properties, **own, **known, "comment": comment}}


def _tag(endring: Endring) -> str:
    if endring.nvdb_id is not None:
        return name(endring.type_id, endring.nvdb_id)
    return f"{'Skiltpunkt' if endring.type_id == SKILTPUNKT else 'Skiltplate'} {endring.temp_id}"


def _known(operasjon: str, nvdb_id: int | None, versjon: int | None) -> dict[str, Any]:
    """What an object of NVDB needs; nothing for a new one."""
    if nvdb_id is None:
        return {}
    return {"nvdbId": nvdb_id, "nvdbVersion": versjon, "operation": OPERATION[operasjon]}


def _remarks(endring: Endring, parent: str | None) -> Iterator[str]:
    """Say what the form has no place for."""
    day = endring.startdato or endring.lukkedato
    if day is not None:
        yield f"From {day.isoformat()}."
    if parent is not None:
        yield f"Hangs on {parent}."
    if any(e.geometri is not None for e in endring.egenskaper):
        yield "Measured from pictures (datafangstmetode fot)."


def _value(values: tuple[int, ...] | tuple[str, ...]) -> str:
    """Give an enum id or a value as text, as the documentation's examples do."""
    return ";".join(str(value) for value in values)


def _point(geometri: Geometri) -> dict[str, Any]:
    east, north, height = point_from_wkt(geometri.wkt)
    latitude, longitude = geographic_from_utm33(east, north)
    position = [round(float(longitude), _DECIMALS), round(float(latitude), _DECIMALS)]
    return {"type": "Point", "coordinates": position if height is None else [*position, height]}


def _quality(geometri: Geometri) -> dict[str, str]:
    """Give numbers as text, as the documentation wants them; what is not known is left out."""
    kvalitet = geometri.kvalitet
    values = {
        "captureDate": geometri.datafangstdato,
        "accuracy": kvalitet and kvalitet.noyaktighet_cm,
        "accuracyHeight": kvalitet and kvalitet.noyaktighet_hoyde_cm,
        "visibility": kvalitet and kvalitet.synbarhet,
    }
    return {key: str(value) for key, value in values.items() if value is not None}
