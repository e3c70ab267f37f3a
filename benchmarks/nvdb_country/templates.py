"""JSON templates of generated signs in V4's and in Uberiket's form, and the numbers that fill them.

Fields, ids and texts are those of the real schema and of recorded pages; the signs are invented.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from nvdb.datakatalog.ids import ANSIKTSSIDE, SKILTNUMMER, SKILTPLATE, SKILTPUNKT
from nvdb.datakatalog.katalog import snapshot

FIRST_ID: Final[Mapping[int, int]] = {SKILTPUNKT: 78_000_001, SKILTPLATE: 402_000_003}
"""Vegobjekttype → id of its first object."""
ID_STEP: Final = 7
"""Ids have gaps, as real ones have."""

Item = tuple[int, int, str]
"""Id, version and JSON of an object."""
Column = npt.NDArray[np.uint64]

_TOWNS: Final = (
    (301, 262_000, 6_649_000), (1103, -32_000, 6_570_000), (1508, 50_000, 6_957_000),
    (1804, 474_000, 7_463_000), (3403, 285_000, 6_747_000), (4204, 88_000, 6_465_000),
    (4601, -33_000, 6_732_000), (5001, 270_000, 7_041_000), (5006, 340_000, 7_103_000),
    (5501, 653_000, 7_733_000),
)  # fmt: skip
"""Kommune, and roughly where its centre lies in UTM33."""
_SPREAD_M: Final = 30_000
_METHODS: Final = (("ukj", 100), ("ukj", 100), ("ukj", 119), ("sat", 10), ("dig", 200), ("fot", 30))

_HEAD_V4 = (
    '{"id":%(id)s,"href":"https://nvdbapiles.atlas.vegvesen.no/vegobjekter/TYPE/%(id)s","metadata":{"type":'
    '{"id":TYPE,"navn":"NAVN"},"versjon":%(versjon)d,"startdato":"%(startdato)s","sist_modifisert":'
    '"%(endret)sZ"},"egenskaper":['
)
_TAIL_V4 = (
    '],"relasjoner":{RELASJONER},"lokasjon":{"kommuner":[%(kommune)d],"fylker":[%(fylke)d],'
    '"kontraktsområder":[],"vegforvaltere":[],"adresser":[],"vegsystemreferanser":[{"vegsystem":{'
    '"vegkategori":"F","fase":"V","nummer":%(veg)d},"strekning":{"strekning":1,"delstrekning":1,'
    '"arm":false,"adskilte_løp":"Nei","trafikantgruppe":"K","retning":"%(retning)s","meter":%(meter)d},'
    '"kortform":"FV%(veg)d S1D1 m%(meter)d"}],"stedfestinger":[{"type":"Punkt","veglenkesekvensid":%(lenke)s,'
    '"relativPosisjon":%(posisjon)s,"retning":"%(retning)s","kjørefelt":["1"],"sideposisjon":"%(side)s",'
    '"kortform":"%(posisjon)s@%(lenke)s"}],"geometri":{"wkt":"%(net)s","srid":5973}},"geometri":{"wkt":'
    '"GEOMETRI","srid":5973,"egengeometri":OWN},"vegsegmenter":[{"veglenkesekvensid":%(lenke)s,'
    '"relativPosisjon":%(posisjon)s,"startdato":"%(startdato)s","retning":"%(retning)s","detaljnivå":'
    '"Vegtrase","typeVeg":"Enkel bilveg","geometri":{"wkt":"%(net)s","srid":5973},"kommune":%(kommune)d,'
    '"fylke":%(fylke)d,"vegsystemreferanse":{"vegsystem":{"vegkategori":"F","fase":"V","nummer":%(veg)d},'
    '"strekning":{"strekning":1,"delstrekning":1,"arm":false,"adskilte_løp":"Nei","trafikantgruppe":"K",'
    '"retning":"%(retning)s","meter":%(meter)d},"kortform":"FV%(veg)d S1D1 m%(meter)d"}}]}'
)
_GEOMETRY_V4 = (
    ',{"id":GEOMID,"navn":"Geometri, punkt","verdi":"%(wkt)s","kvalitet":{"datafangstmetode":"%(metode)s",'
    '"nøyaktighet":%(noyaktighet)d,"synbarhet":0,"maksimaltAvvik":-1},"egenskapstype":"Geometri"}'
)
_POINT_V4 = (
    '{"id":1876,"navn":"Oppsettingsutstyr","verdi":"Stolpe 60,3 mm (2\\")","enum_id":2866,'
    '"egenskapstype":"Tekstenum"},{"id":1877,"navn":"Antall oppsettingsutstyr","verdi":1,'
    '"egenskapstype":"Heltall"},{"id":10854,"navn":"Tilleggsinformasjon","verdi":".",'
    '"egenskapstype":"Tekst"}'
)
_PLATE_V4 = (
    '{"id":5530,"navn":"Skiltnummer","verdi":%(nummer)s,"enum_id":%(nummer_id)d,"egenskapstype":"Tekstenum"}'
    ',{"id":1894,"navn":"Ansiktsside, rettet mot","verdi":%(flate)s,"enum_id":%(flate_id)d,'
    '"egenskapstype":"Tekstenum"},{"id":5128,"navn":"Plasseringskode","verdi":%(plassering)d,'
    '"egenskapstype":"Heltall"},{"id":1910,"navn":"Tekst","verdi":"%(tekst)s","egenskapstype":"Tekst"},'
    '{"id":1970,"navn":"Størrelse","verdi":"Liten størrelse","enum_id":2621,"egenskapstype":"Tekstenum"},'
    '{"id":11826,"navn":"Eier","verdi":"Fylkeskommune","enum_id":19844,"egenskapstype":"Tekstenum"},'
    '{"id":8064,"navn":"Vedlikeholdsansvarlig","verdi":"Fylkeskommune","enum_id":19932,'
    '"egenskapstype":"Tekstenum"}'
)
_CHILDREN_V4 = (
    '"barn":[{"listeid":220004,"id":200004,"type":{"id":96,"navn":"Skiltplate"},"relasjonstype":'
    '"vegobjektIder","vegobjekter":%(plater)s}]'
)
_PARENT_V4 = (
    '"foreldre":[{"id":220004,"type":{"id":95,"navn":"Skiltpunkt"},"relasjonstype":"vegobjektIder",'
    '"vegobjekter":[%(punkt)s]}]'
)

_HEAD_UB = (
    '{"id":%(id)s,"versjon":%(versjon)d,"typeId":TYPE,"gyldighetsperiode":{"startdato":"%(startdato)s"},'
    '"egenskaper":{'
)
_TAIL_UB = (
    '},"barn":{BARN},"stedfesting":{"type":"StedfestingPunkter","punkter":[{"id":%(lenke)s,"posisjon":'
    '%(posisjon)s,"retning":"%(retning)s","sideposisjon":"%(side)s","kjorefelt":["1"]}]},"sistEndret":'
    '"%(endret)sZ"}'
)
_GEOMETRY_UB = (
    ',"GEOMID":{"type":"GeometriEgenskap","verdi":{"wkt":"%(wkt)s","srid":5973,"kvalitet":{'
    '"datafangstmetode":"%(metode)s","noyaktighet":%(noyaktighet)d,"synbarhet":0,"maksimaltAvvik":-1}}}'
)
_POINT_UB = (
    '"1876":{"type":"EnumEgenskap","verdi":2866},"1877":{"type":"HeltallEgenskap","verdi":1},'
    '"10854":{"type":"TekstEgenskap","verdi":"."}'
)
_PLATE_UB = (
    '"5530":{"type":"EnumEgenskap","verdi":%(nummer_id)d},"1894":{"type":"EnumEgenskap","verdi":%(flate_id)d}'
    ',"5128":{"type":"HeltallEgenskap","verdi":%(plassering)d},"1910":{"type":"TekstEgenskap","verdi":'
    '"%(tekst)s"},"1970":{"type":"EnumEgenskap","verdi":2621},"11826":{"type":"EnumEgenskap","verdi":19844},'
    '"8064":{"type":"EnumEgenskap","verdi":19932}'
)


def _filled(template: str, **words: str) -> str:
    for word, text in words.items():
        template = template.replace(word, text)
    return template


def _pair(head: str, body: str, geometry: str, tail: str, **words: str) -> tuple[str, str]:
    """Templates of an object without and with own geometry."""
    without = _filled(head + body + tail, GEOMETRI="%(net)s", OWN="false", **words)
    own = _filled(head + body + geometry + tail, GEOMETRI="%(wkt)s", OWN="true", **words)
    return without, own


_POINT = {"TYPE": "95", "NAVN": "Skiltpunkt", "GEOMID": "4794"}
_PLATE = {"TYPE": "96", "NAVN": "Skiltplate", "GEOMID": "4795"}
LES_V4: Final[Mapping[int, tuple[str, str]]] = {
    SKILTPUNKT: _pair(_HEAD_V4, _POINT_V4, _GEOMETRY_V4, _TAIL_V4, RELASJONER=_CHILDREN_V4, **_POINT),
    SKILTPLATE: _pair(_HEAD_V4, _PLATE_V4, _GEOMETRY_V4, _TAIL_V4, RELASJONER=_PARENT_V4, **_PLATE),
}
"""Vegobjekttype → templates in V4's form (``inkluder=alle``), without and with own geometry."""
UBERIKET: Final[Mapping[int, tuple[str, str]]] = {
    SKILTPUNKT: _pair(_HEAD_UB, _POINT_UB, _GEOMETRY_UB, _TAIL_UB, BARN='"220004":%(plater)s', **_POINT),
    SKILTPLATE: _pair(_HEAD_UB, _PLATE_UB, _GEOMETRY_UB, _TAIL_UB, BARN="", **_PLATE),
}
"""The same in Uberiket's form."""


Maker = Callable[[str, int, int, int], list[Item]]
_HOT: Final = ("id", "wkt", "net", "lenke", "posisjon", "plater", "punkt")
"""Fields that differ from object to object; the others are filled in once for each variant."""
_VARIANTS: Final = 16


def item_maker(n_points: int, n_plates: int, seed: int) -> Maker:
    """Make a function of API (``les-v4`` or ``uberiket``), type, first and last number → objects.

    Filling in two steps is what makes it fast: a variant (town, what the point is like, what the object is
    like) becomes a template of few fields, and that template becomes an object.
    """
    variants: dict[tuple[str, int, int, int, int], tuple[int, str]] = {}

    def variant(api: str, type_id: int, town: int, place: int, life: int) -> tuple[int, str]:
        key = api, type_id, town, place, life
        if key not in variants:
            variants[key] = _variant(*key)
        return variants[key]

    def items(api: str, type_id: int, start: int, stop: int) -> list[Item]:
        numbers = range(start, max(start, min(stop, n_points if type_id == SKILTPUNKT else n_plates)))
        index = np.arange(numbers.start, numbers.stop, dtype=np.uint64)
        points = index if type_id == SKILTPUNKT else index * np.uint64(n_points) // np.uint64(n_plates)
        columns = (points, _mixed(points, seed * 8 + 1), _mixed(points, seed * 8 + 2))
        draws = _mixed(index, seed * 8 + type_id).tolist()
        made = []
        for number, draw, point, first, second in zip(
            numbers, draws, *(c.tolist() for c in columns), strict=True
        ):
            town = point * len(_TOWNS) // n_points
            versjon, template = variant(api, type_id, town, first % _VARIANTS, draw % _VARIANTS)
            object_id = FIRST_ID[type_id] + ID_STEP * number
            hot = _place(town, first, second)
            hot["id"] = object_id
            if type_id == SKILTPUNKT:
                hot["plater"] = _plates(point, n_points, n_plates)
            else:
                hot["punkt"] = FIRST_ID[SKILTPUNKT] + ID_STEP * point
            made.append((object_id, versjon, template % hot))
        return made

    return items


def _place(town: int, first: int, second: int) -> dict[str, object]:
    """Where a point stands, which its plates share."""
    _, centre_east_m, centre_north_m = _TOWNS[town]
    east_m = centre_east_m + _SPREAD_M * (first / 2**53 - 0.5)
    north_m = centre_north_m + _SPREAD_M * (second / 2**53 - 0.5)
    height = f"{second % 40_000 / 100:.2f}"
    known = height if _is_measured(first % _VARIANTS) else "-999999"
    return {
        "wkt": f"POINT Z ({east_m:.3f} {north_m:.3f} {known})",
        "net": f"POINT Z ({east_m + 4:.3f} {north_m:.3f} {height})",
        "lenke": 1_000_000 + second % 2_000_000,
        "posisjon": f"{first / 2**53:.8f}",
    }


def _variant(api: str, type_id: int, town: int, place: int, life: int) -> tuple[int, str]:
    """Version of a variant's objects, and its template: everything filled in but the fields of `_HOT`."""
    katalog = snapshot()
    signs = _enum(katalog.egenskapstyper[SKILTNUMMER].verdier)
    faces = _enum(katalog.egenskapstyper[ANSIKTSSIDE].verdier)
    kommune = _TOWNS[town][0]
    metode, noyaktighet = _METHODS[place % len(_METHODS)]
    nummer_id, nummer = signs[(life + _VARIANTS * place + 37 * town) % len(signs)]
    flate_id, flate = faces[(life + place) % len(faces)]
    own = place != 0
    row = {
        **{name: f"%({name})s" for name in _HOT},
        "kommune": kommune,
        "fylke": kommune // 100,
        "metode": metode,
        "noyaktighet": noyaktighet,
        "veg": 100 * town + place + 1,
        "meter": 500 * place,
        "retning": "MED" if place % 2 else "MOT",
        "side": "H" if place % 3 else "V",
        "versjon": 1 + life % 3,
        "startdato": f"{2005 + life}-{1 + life % 12:02d}-{1 + life:02d}",
        "endret": f"2025-{1 + life % 12:02d}-{1 + life:02d}T{life:02d}:00:00",
        "nummer_id": nummer_id,
        "nummer": nummer.replace("%", "%%"),
        "flate_id": flate_id,
        "flate": flate,
        "plassering": 10 + 10 * (life % 3),
        "tekst": str(10 * life),
    }
    templates = LES_V4 if api == "les-v4" else UBERIKET
    return 1 + life % 3, templates[type_id][own] % row


def _is_measured(place: int) -> bool:
    """Whether heights of a variant are known."""
    return _METHODS[place % len(_METHODS)][0] != "ukj"


def _enum(values: Mapping[int, object]) -> list[tuple[int, str]]:
    return [(enum_id, json.dumps(text, ensure_ascii=False)) for enum_id, text in values.items()]


def _mixed(numbers: Column, salt: int) -> Column:
    """Scramble 64 bits so that neighbours have nothing in common (splitmix64, Steele et al. 2014)."""
    z = (numbers + np.uint64((salt * 0xD1342543DE82EF95 + 1) % 2**64)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed: Column = (z ^ (z >> np.uint64(31))) >> np.uint64(11)  # 53 bits: a float holds them exactly
    return mixed


def _plates(point: int, n_points: int, n_plates: int) -> str:
    """Ids of a point's plates: plate *j* belongs to point ⌊j · points / plates⌋."""
    first, last = -(-point * n_plates // n_points), -(-(point + 1) * n_plates // n_points)
    return str([FIRST_ID[SKILTPLATE] + ID_STEP * plate for plate in range(first, last)])
