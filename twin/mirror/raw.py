"""How the store keeps an object as received: its own text, deflated with a dictionary of what all share.

A sign's JSON is 2 kB, of which nine tenths are names of fields and values that every sign has. A preset
dictionary (RFC 1950, FDICT) lets an object be kept for itself, at a ninth of its size. zlib-ng writes it in
half the time that zlib takes; the form is the same, and zlib reads it.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any, Final

from zlib_ng import zlib_ng

_DICTIONARY: Final = (
    '{"id":1588,"navn":"Høyde, egen","verdi":1400,"enhet":{"id":4,"navn":"Millimeter","kortnavn":"mm"},'
    '"egenskapstype":"Heltall"},{"id":1328,"navn":"Bredde, målt","verdi":1000,"enhet":{"id":4,"navn":"M'
    'illimeter","kortnavn":"mm"},"egenskapstype":"Heltall"},{"id":1912,"navn":"Tekst-/Symbolhøyde","ver'
    'di":105,"enum_id":3481,"enhet":{"id":4,"navn":"Millimeter","kortnavn":"mm"},"egenskapstype":"Helta'
    'llenum"},{"id":2108,"navn":"Oppsettingsdato","verdi":"1990-01-01","egenskapstype":"Dato"},{"id":12'
    '94,"navn":"Farge","verdi":"Hvit","enum_id":2124,"egenskapstype":"Tekstenum"},{"id":1892,"navn":"Sk'
    'iltform","verdi":"Profil","enum_id":2856,"egenskapstype":"Tekstenum"},{"id":1879,"navn":"Belysning'
    '","verdi":"Ingen","enum_id":3476,"egenskapstype":"Tekstenum"},{"id":1921,"navn":"Folieklasse","ver'
    'di":"Klasse 1","enum_id":2848,"egenskapstype":"Tekstenum"},{"id":11079,"navn":"Prosjektreferanse",'
    '"verdi":"","egenskapstype":"Tekst"},{"id":11536,"navn":"Tilleggsinformasjon","verdi":".","egenskap'
    'stype":"Tekst"},{"id":1894,"navn":"Ansiktsside, rettet mot","verdi":"Trafikk mot metreringsretning'
    '","enum_id":2717,"egenskapstype":"Tekstenum"},{"id":1894,"navn":"Ansiktsside, rettet mot","verdi":'
    '"Trafikk i metreringsretning","enum_id":2714,"egenskapstype":"Tekstenum"}{"id":78000008,"versjon":'
    '3,"typeId":95,"gyldighetsperiode":{"startdato":"2007-03-03"},"egenskaper":{"1876":{"type":"EnumEge'
    'nskap","verdi":2866},"1877":{"type":"HeltallEgenskap","verdi":1},"10854":{"type":"TekstEgenskap","'
    'verdi":"."},"4794":{"type":"GeometriEgenskap","verdi":{"wkt":"POINT Z (265396.226 6654537.356 60.0'
    '7)","srid":5973,"kvalitet":{"datafangstmetode":"dig","noyaktighet":200,"synbarhet":0,"maksimaltAvv'
    'ik":-1}}}},"barn":{"220004":[402000024,402000031,402000038]},"stedfesting":{"type":"StedfestingPun'
    'kter","punkter":[{"id":2886007,"posisjon":0.61320752,"retning":"MOT","sideposisjon":"H","kjorefelt'
    '":["1"]}]},"sistEndret":"2025-03-03T02:00:00Z"}{"id":402000010,"versjon":2,"typeId":96,"gyldighets'
    'periode":{"startdato":"2012-08-08"},"egenskaper":{"5530":{"type":"EnumEgenskap","verdi":7690},"189'
    '4":{"type":"EnumEgenskap","verdi":3698},"5128":{"type":"HeltallEgenskap","verdi":20},"1910":{"type'
    '":"TekstEgenskap","verdi":"70"},"1970":{"type":"EnumEgenskap","verdi":2621},"11826":{"type":"EnumE'
    'genskap","verdi":19844},"8064":{"type":"EnumEgenskap","verdi":19932},"4795":{"type":"GeometriEgens'
    'kap","verdi":{"wkt":"POINT Z (275095.411 6661458.245 -999999)","srid":5973,"kvalitet":{"datafangst'
    'metode":"ukj","noyaktighet":119,"synbarhet":0,"maksimaltAvvik":-1}}}},"barn":{},"stedfesting":{"ty'
    'pe":"StedfestingPunkter","punkter":[{"id":2933327,"posisjon":0.9365137,"retning":"MOT","sideposisj'
    'on":"H","kjorefelt":["1"]}]},"sistEndret":"2025-08-08T07:00:00Z"}{"id":78000008,"href":"https://nv'
    'dbapiles.atlas.vegvesen.no/vegobjekter/95/78000008","metadata":{"type":{"id":95,"navn":"Skiltpunkt'
    '"},"versjon":3,"startdato":"2007-03-03","sist_modifisert":"2025-03-03T02:00:00Z"},"egenskaper":[{"'
    'id":1876,"navn":"Oppsettingsutstyr","verdi":"Stolpe 60,3 mm (2\\")","enum_id":2866,"egenskapstype":'
    '"Tekstenum"},{"id":1877,"navn":"Antall oppsettingsutstyr","verdi":1,"egenskapstype":"Heltall"},{"i'
    'd":10854,"navn":"Tilleggsinformasjon","verdi":".","egenskapstype":"Tekst"},{"id":4794,"navn":"Geom'
    'etri, punkt","verdi":"POINT Z (265396.226 6654537.356 60.07)","kvalitet":{"datafangstmetode":"dig"'
    ',"nøyaktighet":200,"synbarhet":0,"maksimaltAvvik":-1},"egenskapstype":"Geometri"}],"relasjoner":{"'
    'barn":[{"listeid":220004,"id":200004,"type":{"id":96,"navn":"Skiltplate"},"relasjonstype":"vegobje'
    'ktIder","vegobjekter":[402000024,402000031,402000038]}]},"lokasjon":{"kommuner":[301],"fylker":[3]'
    ',"kontraktsområder":[],"vegforvaltere":[],"adresser":[],"vegsystemreferanser":[{"vegsystem":{"vegk'
    'ategori":"F","fase":"V","nummer":11},"strekning":{"strekning":1,"delstrekning":1,"arm":false,"adsk'
    'ilte_løp":"Nei","trafikantgruppe":"K","retning":"MOT","meter":5000},"kortform":"FV11 S1D1 m5000"}]'
    ',"stedfestinger":[{"type":"Punkt","veglenkesekvensid":2886007,"relativPosisjon":0.61320752,"retnin'
    'g":"MOT","kjørefelt":["1"],"sideposisjon":"H","kortform":"0.61320752@2886007"}],"geometri":{"wkt":'
    '"POINT Z (265400.226 6654537.356 60.07)","srid":5973}},"geometri":{"wkt":"POINT Z (265396.226 6654'
    '537.356 60.07)","srid":5973,"egengeometri":true},"vegsegmenter":[{"veglenkesekvensid":2886007,"sta'
    'rtposisjon":0.61320752,"sluttposisjon":0.61320752,"lengde":0.0,"retning":"MOT","detaljnivå":"Vegtr'
    'ase","typeVeg":"Enkel bilveg","kommune":301,"fylke":3}]}{"id":402000010,"href":"https://nvdbapiles'
    '.atlas.vegvesen.no/vegobjekter/96/402000010","metadata":{"type":{"id":96,"navn":"Skiltplate"},"ver'
    'sjon":2,"startdato":"2012-08-08","sist_modifisert":"2025-08-08T07:00:00Z"},"egenskaper":[{"id":553'
    '0,"navn":"Skiltnummer","verdi":"402.8","enum_id":7690,"egenskapstype":"Tekstenum"},{"id":1894,"nav'
    'n":"Ansiktsside, rettet mot","verdi":"Tosidig","enum_id":3698,"egenskapstype":"Tekstenum"},{"id":5'
    '128,"navn":"Plasseringskode","verdi":20,"egenskapstype":"Heltall"},{"id":1910,"navn":"Tekst","verd'
    'i":"70","egenskapstype":"Tekst"},{"id":1970,"navn":"Størrelse","verdi":"Liten størrelse","enum_id"'
    ':2621,"egenskapstype":"Tekstenum"},{"id":11826,"navn":"Eier","verdi":"Fylkeskommune","enum_id":198'
    '44,"egenskapstype":"Tekstenum"},{"id":8064,"navn":"Vedlikeholdsansvarlig","verdi":"Fylkeskommune",'
    '"enum_id":19932,"egenskapstype":"Tekstenum"},{"id":4795,"navn":"Geometri, punkt","verdi":"POINT Z '
    '(275095.411 6661458.245 -999999)","kvalitet":{"datafangstmetode":"ukj","nøyaktighet":119,"synbarhe'
    't":0,"maksimaltAvvik":-1},"egenskapstype":"Geometri"}],"relasjoner":{"foreldre":[{"id":220004,"typ'
    'e":{"id":95,"navn":"Skiltpunkt"},"relasjonstype":"vegobjektIder","vegobjekter":[78000001]}]},"loka'
    'sjon":{"kommuner":[301],"fylker":[3],"kontraktsområder":[],"vegforvaltere":[],"adresser":[],"vegsy'
    'stemreferanser":[{"vegsystem":{"vegkategori":"F","fase":"V","nummer":3},"strekning":{"strekning":1'
    ',"delstrekning":1,"arm":false,"adskilte_løp":"Nei","trafikantgruppe":"K","retning":"MOT","meter":1'
    '000},"kortform":"FV3 S1D1 m1000"}],"stedfestinger":[{"type":"Punkt","veglenkesekvensid":2933327,"r'
    'elativPosisjon":0.9365137,"retning":"MOT","kjørefelt":["1"],"sideposisjon":"H","kortform":"0.93651'
    '370@2933327"}],"geometri":{"wkt":"POINT Z (275099.411 6661458.245 133.27)","srid":5973}},"geometri'
    '":{"wkt":"POINT Z (275095.411 6661458.245 -999999)","srid":5973,"egengeometri":true},"vegsegmenter'
    '":[{"veglenkesekvensid":2933327,"startposisjon":0.9365137,"sluttposisjon":0.9365137,"lengde":0.0,"'
    'retning":"MOT","detaljnivå":"Vegtrase","typeVeg":"Enkel bilveg","kommune":301,"fylke":3}]}'
).encode()
"""Part of the store's form: another text here cannot read what was written with this one."""

_LEVEL: Final = 1
_WINDOW_BITS: Final = 13
"""8 kB: the dictionary and an object of usual size."""
_MEMORY_LEVEL: Final = 4
"""A small state is quick to copy."""

_FRESH: Final[Any] = zlib_ng.compressobj(
    _LEVEL, zlib.DEFLATED, _WINDOW_BITS, _MEMORY_LEVEL, zlib.Z_DEFAULT_STRATEGY, _DICTIONARY
)
"""A compressor that has read the dictionary: to copy it is quicker than to read the dictionary again.
(Any: the stubs of zlib-ng leave `copy` out.)"""


def packed(raw: Mapping[str, Any]) -> bytes:
    """An object as the store keeps it: the text that it was read from, or else its JSON."""
    text = getattr(raw, "text", None)
    if not isinstance(text, bytes):
        # A lone surrogate has no UTF-8, but JSON may hold one.
        text = json.dumps(raw, ensure_ascii=False, separators=(",", ":")).encode("utf-8", "surrogatepass")
    compressor = _FRESH.copy()
    deflated: bytes = compressor.compress(text) + compressor.flush()
    return deflated


def raw_text(stored: bytes) -> str:
    """The JSON text of a stored object."""
    decompressor = zlib.decompressobj(zdict=_DICTIONARY)
    return (decompressor.decompress(stored) + decompressor.flush()).decode("utf-8", "surrogatepass")


def same_object(stored: bytes, other: bytes) -> bool:
    """Whether two stored objects say the same, however each is spelled: spaces and the order of fields."""
    one, two = (json.dumps(json.loads(raw_text(text)), sort_keys=True) for text in (stored, other))
    return one == two


def raw_object(row: Mapping[str, Any]) -> dict[str, Any]:
    """The object of a row of the mirror (its column ``raw``), parsed as it was received."""
    parsed: dict[str, Any] = json.loads(raw_text(row["raw"]))
    return parsed
