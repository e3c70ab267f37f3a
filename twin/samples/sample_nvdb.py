"""The road database around the sample drive: pages as API Les V4 sends them, with invented objects.

Only the form, the property ids and the enum ids are NVDB's own (datakatalog, NLOD 1.0); every object, id,
reference and position is made up from the simulated world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from nvdb.datakatalog import (
    ANSIKTSSIDE,
    EGENSKAPER_95,
    EGENSKAPER_96,
    GEOMETRI_PUNKT,
    PLASSERINGSKODE,
    SKILTNUMMER,
    SKILTNUMMER_ENUM,
    SKILTPLATE,
    SKILTPLATER_I_SKILTPUNKT,
    SKILTPUNKT,
    TEKST,
    Ansiktsside,
)

KOMMUNE, FYLKE = 5001, 50
MAIN_ROAD, MAIN_LINK = "KV2210", 3041771
SIDE_ROAD, SIDE_LINK = "KV2214", 3041802
API = "https://nvdbapiles.atlas.vegvesen.no/vegobjekter"
PAGE_SIZE = 20
UNKNOWN_HEIGHT = -999999
LAST_MODIFIED = "2025-11-03T09:12:44Z"
LINK_LENGTH_M = 1000.0

CODE_NAMES = {
    "108": "Ujevn veg",
    "142": "Barn",
    "202": "Vikeplikt",
    "204": "Stopp",
    "302": "Innkjøring forbudt",
    "362.30": "Fartsgrense 30 km/t",
    "362.50": "Fartsgrense 50 km/t",
    "362.60": "Fartsgrense 60 km/t",
    "366": "Fartsgrensesone",
    "372": "Parkering forbudt",
    "404.1": "Påbudt kjørefelt, høyre",
    "406": "Påbudt rundkjøring",
    "512": "Holdeplass for buss",
    "516": "Gangfelt",
    "522": "Gang- og sykkelveg",
    "802": "Avstand",
    "808.105": "Fartsdempere/Fartsdemparar",
    "906H": "Hindermarkering, hinder til høyre",
    "906V": "Hindermarkering, hinder til venstre",
}
TEXTS = {"802": "150 m", "366": "40", "808.105": "Fartsdempere"}


@dataclass(frozen=True, slots=True)
class NvdbPole:
    """One Skiltpunkt with its plates, as the database has it.

    Attributes
    ----------
    point_id : int
    plate_ids : tuple of int
        Top down, as `codes`.
    codes : tuple of str
    east_m, north_m : float
        EPSG:25833; the point on the centre line where `own_geometry` is false.
    height_m : float or None
        NN2000.
    own_geometry : bool
    accuracy_cm : int
    capture_method : str
    road : str
        Vegkategori, fase and number, ``KV2210``.
    link_id : int
        Veglenkesekvens.
    meter : float
        Along the road, in metering direction.
    right : bool
        On the right-hand side in metering direction.
    centre_east_m, centre_north_m : float
        Foot of the perpendicular on the centre line.
    """

    point_id: int
    plate_ids: tuple[int, ...]
    codes: tuple[str, ...]
    east_m: float
    north_m: float
    height_m: float | None
    own_geometry: bool
    accuracy_cm: int
    capture_method: str
    road: str
    link_id: int
    meter: float
    right: bool
    centre_east_m: float
    centre_north_m: float


def skiltpunkt_document(pole: NvdbPole) -> dict[str, Any]:
    """Return one object of type 95 as ``inkluder=alle&srid=5973`` gives it."""
    barn = {
        "listeid": SKILTPLATER_I_SKILTPUNKT,
        "id": SKILTPLATER_I_SKILTPUNKT - 20_000,
        "type": {"id": SKILTPLATE, "navn": "Skiltplate"},
        "relasjonstype": "vegobjektIder",
        "vegobjekter": list(pole.plate_ids),
    }
    egenskaper: list[dict[str, Any]] = [
        {"id": 1877, "navn": EGENSKAPER_95[1877], "verdi": 1, "egenskapstype": "Heltall"}
    ]
    return _object(pole, SKILTPUNKT, "Skiltpunkt", pole.point_id, egenskaper, {"barn": [barn]})


def skiltplate_documents(pole: NvdbPole) -> list[dict[str, Any]]:
    """Return the plates of a pole, objects of type 96."""
    foreldre = {
        "listeid": SKILTPLATER_I_SKILTPUNKT,
        "id": SKILTPLATER_I_SKILTPUNKT - 20_000,
        "type": {"id": SKILTPUNKT, "navn": "Skiltpunkt"},
        "relasjonstype": "vegobjektIder",
        "vegobjekter": [pole.point_id],
    }
    return [
        _object(
            pole, SKILTPLATE, "Skiltplate", plate_id, _plate_properties(code, place), {"foreldre": [foreldre]}
        )
        for place, (plate_id, code) in enumerate(zip(pole.plate_ids, pole.codes, strict=True), start=1)
    ]


def pages(type_id: int, objects: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Cut objects into pages in the order of their ids; each page names the cursor of the next."""
    ordered = sorted(objects, key=lambda o: int(o["id"]))
    found = []
    for first in range(0, len(ordered), PAGE_SIZE):
        part = ordered[first : first + PAGE_SIZE]
        start = f"{part[-1]['id']}:{part[-1]['metadata']['versjon']}"
        query = f"kommune={KOMMUNE}&inkluder=alle&srid=5973&start={start}&antall={PAGE_SIZE}"
        found.append(
            {
                "objekter": part,
                "metadata": {
                    "returnert": len(part),
                    "sidestørrelse": PAGE_SIZE,
                    "neste": {"start": start, "href": f"{API}/{type_id}?{query}"},
                },
            }
        )
    return found


def vegnett_page(centre_line: Sequence[tuple[float, float, float, float]]) -> dict[str, Any]:
    """Return the one page of the road network: the main road as one segment.

    Parameters
    ----------
    centre_line : sequence of (meter, east, north, height)
        Metering in metres, EPSG:25833, NN2000.
    """
    first, last = centre_line[0][0], centre_line[-1][0]
    wkt = ", ".join(f"{east:.3f} {north:.3f} {height:.3f}" for _, east, north, height in centre_line)
    segment = {
        "veglenkesekvensid": MAIN_LINK,
        "veglenkenummer": 1,
        "segmentnummer": 1,
        "referanse": f"{MAIN_LINK}-1-1",
        "metadata": {"startdato": "2015-03-01"},
        "startposisjon": first / LINK_LENGTH_M,
        "sluttposisjon": last / LINK_LENGTH_M,
        "type": "HOVED",
        "detaljnivå": "Vegtrase og kjørebane",
        "topologinivå": "Vegtrase",
        "typeVeg_sosi": "enkelBilveg",
        "feltoversikt": ["1", "2"],
        "geometri": {"wkt": f"LINESTRING Z ({wkt})", "srid": 5973},
        "kommune": KOMMUNE,
        "fylke": FYLKE,
        "vegsystemreferanse": {
            "vegsystem": {"vegkategori": MAIN_ROAD[0], "fase": MAIN_ROAD[1], "nummer": int(MAIN_ROAD[2:])},
            "strekning": {
                "strekning": 1,
                "delstrekning": 1,
                "arm": False,
                "trafikantgruppe": "K",
                "retning": "MED",
                "fra_meter": first,
                "til_meter": last,
            },
            "kortform": f"{MAIN_ROAD} S1D1 m{first:.0f}-{last:.0f}",
        },
    }
    return {"objekter": [segment], "metadata": {"returnert": 1, "sidestørrelse": PAGE_SIZE}}


def _plate_properties(code: str, place: int) -> list[dict[str, Any]]:
    egenskaper: list[dict[str, Any]] = [
        {
            "id": PLASSERINGSKODE,
            "navn": EGENSKAPER_96[PLASSERINGSKODE],
            "verdi": place * 10,
            "egenskapstype": "Heltall",
        },
        {
            "id": ANSIKTSSIDE,
            "navn": EGENSKAPER_96[ANSIKTSSIDE],
            "verdi": "Trafikk i metreringsretning",
            "enum_id": int(Ansiktsside.MED_METRERINGSRETNING),
            "egenskapstype": "Tekstenum",
        },
        {
            "id": SKILTNUMMER,
            "navn": EGENSKAPER_96[SKILTNUMMER],
            "verdi": f"{code} - {CODE_NAMES[code]}",
            "enum_id": SKILTNUMMER_ENUM[code],
            "egenskapstype": "Tekstenum",
        },
    ]
    if code in TEXTS:
        text = {"id": TEKST, "navn": EGENSKAPER_96[TEKST], "verdi": TEXTS[code], "egenskapstype": "Tekst"}
        egenskaper.append(text)
    return egenskaper


def _object(
    pole: NvdbPole,
    type_id: int,
    type_name: str,
    object_id: int,
    egenskaper: list[dict[str, Any]],
    relasjoner: dict[str, Any],
) -> dict[str, Any]:
    """Return what both types share: metadata, geometry and place on the road network."""
    wkt = _wkt(pole.east_m, pole.north_m, pole.height_m)
    centre = _wkt(pole.centre_east_m, pole.centre_north_m, pole.height_m)
    if pole.own_geometry:
        egenskaper = [*egenskaper, _geometry_property(pole, type_id, wkt)]
    return {
        "id": object_id,
        "href": f"{API}/{type_id}/{object_id}",
        "metadata": {
            "type": {"id": type_id, "navn": type_name},
            "versjon": 1,
            "startdato": "2019-05-14",
            "sist_modifisert": LAST_MODIFIED,
        },
        "egenskaper": egenskaper,
        "geometri": {
            "wkt": wkt if pole.own_geometry else centre,
            "srid": 5973,
            "egengeometri": pole.own_geometry,
        },
        "lokasjon": _location(pole, centre),
        "relasjoner": relasjoner,
    }


def _geometry_property(pole: NvdbPole, type_id: int, wkt: str) -> dict[str, Any]:
    return {
        "id": GEOMETRI_PUNKT[type_id],
        "navn": "Geometri, punkt",
        "verdi": wkt,
        "kvalitet": {
            "datafangstmetode": pole.capture_method,
            "nøyaktighet": pole.accuracy_cm,
            "synbarhet": 0,
            "maksimaltAvvik": -1,
        },
        "datafangstdato": "2019-05-14",
        "egenskapstype": "Geometri",
    }


def _location(pole: NvdbPole, centre: str) -> dict[str, Any]:
    position = round(pole.meter / LINK_LENGTH_M, 8)
    return {
        "kommuner": [KOMMUNE],
        "fylker": [FYLKE],
        "vegsystemreferanser": [
            {
                "vegsystem": {
                    "vegkategori": pole.road[0],
                    "fase": pole.road[1],
                    "nummer": int(pole.road[2:]),
                },
                "strekning": {
                    "strekning": 1,
                    "delstrekning": 1,
                    "arm": False,
                    "adskilte_løp": "Nei",
                    "trafikantgruppe": "K",
                    "retning": "MED",
                    "meter": round(pole.meter, 3),
                },
                "kortform": f"{pole.road} S1D1 m{pole.meter:.0f}",
            }
        ],
        "stedfestinger": [
            {
                "type": "Punkt",
                "veglenkesekvensid": pole.link_id,
                "relativPosisjon": position,
                "retning": "MED",
                "kjørefelt": [],
                "sideposisjon": "H" if pole.right else "V",
                "kortform": f"{position}@{pole.link_id}",
            }
        ],
        "geometri": {"wkt": centre, "srid": 5973},
    }


def _wkt(east_m: float, north_m: float, height_m: float | None) -> str:
    height = str(UNKNOWN_HEIGHT) if height_m is None else f"{height_m:.3f}"
    return f"POINT Z ({east_m:.3f} {north_m:.3f} {height})"
