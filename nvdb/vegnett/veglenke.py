"""Veglenke: one link of the road network, parsed once, at the edge.

Two sources give the same thing. API Les V4 (``/veglenkesekvenser/segmentert``) cuts the links where the road
reference, the kommune or a contract changes and says all of that in each piece. Uberiket V1 gives whole links
between ports and knows no road reference.

What was checked against real answers: the geometry runs from ``startposisjon`` to ``sluttposisjon``, also
where the metering runs the other way; ``geometri.lengde`` is the 3-D length; a period of validity is
half-open (one ends on the day that the next begins).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date
from typing import TYPE_CHECKING, Any, Final

from nvdb.client.fields import Fields
from nvdb.objects.geometri import in_norway

if TYPE_CHECKING:
    from shapely import LineString

RawObject = Mapping[str, Any]

TYPE_VEG: Final[Mapping[str, str]] = {
    "KANALISERT_VEG": "kanalisertVeg", "ENKEL_BILVEG": "enkelBilveg", "RAMPE": "rampe",
    "RUNDKJORING": "rundkjøring", "BILFERJE": "bilferje", "PASSASJERFERJE": "passasjerferje",
    "GANG_OG_SYKKELVEG": "gangOgSykkelveg", "SYKKELVEG": "sykkelveg", "GANGVEG": "gangveg",
    "GAGATE": "gågate", "FORTAU": "fortau", "TRAPP": "trapp", "GANGFELT": "gangfelt",
    "GATETUN": "gatetun", "TRAKTORVEG": "traktorveg", "STI": "sti", "ANNET": "annet",
}  # fmt: skip
"""Uberiket's typeVeg → the SOSI name that Les writes as ``typeVeg_sosi``."""

DETALJNIVA: Final[Mapping[str, str]] = {
    "Vegtrase": "VT", "Kjørebane": "KB", "Kjørefelt": "KF", "Vegtrase og kjørebane": "VTKB",
    "VEGTRASE": "VT", "KJOREBANE": "KB", "KJOREFELT": "KF", "VEGTRASE_OG_KJOREBANE": "VTKB",
}  # fmt: skip
"""Detaljnivå in words (Les, Uberiket) → the short name of the datakatalog."""

_UTM33: Final = frozenset({5973, 25833})


@dataclass(frozen=True, slots=True)
class Vegreferanse:
    """Vegsystemreferanse of a stretch of road.

    Attributes
    ----------
    kortform : str
        As received: ``EV18 S53D1 m2922-3041``.
    vegkategori, fase : str
        ``E R F K P S`` and ``P A V F``; empty if not said.
    nummer : int or None
    trafikantgruppe : str
        ``K`` (driving) or ``G`` (walking, cycling); empty if not said.
    retning : str
        ``MED`` if the link runs with the metering, ``MOT`` if against it, empty if not said.
    fra_meter, til_meter : float or None
        Lowest and highest meter value of the stretch. With ``MOT`` the link begins at `til_meter`.

    Notes
    -----
    In an intersection or a side facility the part with the finest metering counts for the last four:
    kryssystem, else sideanlegg, else strekning.
    """

    kortform: str
    vegkategori: str = ""
    fase: str = ""
    nummer: int | None = None
    trafikantgruppe: str = ""
    retning: str = ""
    fra_meter: float | None = None
    til_meter: float | None = None


@dataclass(frozen=True, slots=True)
class Veglenke:
    """One link, or one piece of it.

    Attributes
    ----------
    veglenkesekvensid, veglenkenummer, segmentnummer : int
        `segmentnummer` is 0 in Uberiket, where links come whole.
    startposisjon, sluttposisjon : float
        Relative positions along the veglenkesekvens, 0 to 1.
    geometri : shapely.LineString
        EPSG:25833, from `startposisjon` to `sluttposisjon`; third coordinate NN2000 (-999999 if unknown).
    lengde_m : float or None
        ``lengde`` as stated. With the method *Metrert* it was measured on the road and may differ from the
        geometry by metres.
    geometri_lengde_m : float or None
        ``geometri.lengde`` as stated: 3-D.
    startdato, sluttdato : date, date or None
        Valid from and including the first, up to and not including the second.
    konnektering : bool
        A link that only ties others together, mostly from an intersection's middle to the road's edge.
    detaljert : bool
        On the level of kjørebane or kjørefelt. NVDB's objects hang on the level of vegtrasé.
    type_veg : str
        SOSI name: ``enkelBilveg``, ``rampe`` … Unknown ones as they came.
    detaljniva : str
        ``VT``, ``VTKB``, ``KB``, ``KF``. Unknown ones as they came.
    feltoversikt : tuple of str
        Lanes, in the direction of the link: odd numbers with it, even ones against it.
    kommune : int or None
    referanse : Vegreferanse or None
    """

    veglenkesekvensid: int
    veglenkenummer: int
    segmentnummer: int
    startposisjon: float
    sluttposisjon: float
    geometri: LineString = field(repr=False)
    startdato: date
    sluttdato: date | None = None
    lengde_m: float | None = None
    geometri_lengde_m: float | None = None
    konnektering: bool = False
    detaljert: bool = False
    type_veg: str = ""
    detaljniva: str = ""
    feltoversikt: tuple[str, ...] = ()
    kommune: int | None = None
    referanse: Vegreferanse | None = None


def veglenke_from_les_v4(raw: RawObject) -> Veglenke:
    """Parse one object of ``/vegnett/api/v4/veglenkesekvenser/segmentert`` (schema ``Veglenkesegment``).

    Raises
    ------
    SchemaError
        A field that is missing or breaks the documented form; the message names the link and the field.
        Unknown fields are ignored, unknown enum values kept.
    """
    fields = Fields(raw, f"veglenke {raw.get('referanse') or raw.get('kortform') or raw.get('href')}")
    kind = fields.text("type") or ""
    niva = fields.text("topologinivå")
    period = fields.child("metadata")
    return Veglenke(
        veglenkesekvensid=fields.required_integer("veglenkesekvensid"),
        veglenkenummer=fields.required_integer("veglenkenummer"),
        segmentnummer=fields.integer("segmentnummer") or 0,
        konnektering="KONNEKTERING" in kind,
        detaljert="DETALJERT" in kind if niva is None else niva != "Vegtrase",
        type_veg=fields.text("typeVeg_sosi") or fields.text("typeVeg") or "",
        referanse=_vegreferanse(fields.child("vegsystemreferanse")),
        **_positions(fields, _position(fields, "startposisjon"), _position(fields, "sluttposisjon")),
        **_shared(fields, fields.text("detaljnivå"), period),
    )


def veglenker_from_uberiket(raw: RawObject) -> Iterator[Veglenke]:
    """Parse one veglenkesekvens of Uberiket V1 (schema ``Veglenkesekvens``) into its links, one by one.

    Where a link begins and ends comes from the ports that it names.

    Raises
    ------
    SchemaError
        As :func:`veglenke_from_les_v4`; also a port that the veglenkesekvens does not have.
    """
    sekvens = Fields(raw, f"veglenkesekvens {raw.get('id')}")
    sekvensid = sekvens.required_integer("id")
    ports = {
        port.required_integer("nummer"): _position(port, "posisjon") for port in sekvens.children("porter")
    }
    for link in sekvens.children("veglenker"):
        nummer = link.required_integer("nummer")
        niva = link.text("topologiniva")
        type_veg = link.text("typeVeg") or ""
        yield Veglenke(
            veglenkesekvensid=sekvensid,
            veglenkenummer=nummer,
            segmentnummer=0,
            konnektering=link.boolean("konnektering"),
            detaljert=niva is not None and niva != "VEGTRASE",
            type_veg=TYPE_VEG.get(type_veg, type_veg),
            **_positions(link, _port(link, "startport", ports), _port(link, "sluttport", ports)),
            **_shared(link, link.text("detaljniva"), link.child("gyldighetsperiode")),
        )


def _shared(fields: Fields, detaljniva: str | None, period: Fields) -> dict[str, Any]:
    """What Les and Uberiket say in the same words."""
    geometri = fields.child("geometri")
    startdato = _date(period, "startdato")
    if startdato is None:
        raise period.error("startdato", "is missing")
    return {
        "geometri": _line(geometri),
        "startdato": startdato,
        "sluttdato": _date(period, "sluttdato"),
        "lengde_m": fields.number("lengde"),
        "geometri_lengde_m": geometri.number("lengde"),
        "detaljniva": DETALJNIVA.get(detaljniva or "", detaljniva or ""),
        "feltoversikt": fields.texts("feltoversikt"),
        "kommune": fields.integer("kommune"),
    }


def _positions(fields: Fields, start: float, slutt: float) -> dict[str, Any]:
    if start > slutt:
        raise fields.error("startposisjon", f"({start:g}) lies after the end ({slutt:g})")
    return {"startposisjon": start, "sluttposisjon": slutt}


def _position(fields: Fields, name: str) -> float:
    value = fields.number(name)
    if value is None:
        raise fields.error(name, "is missing")
    if not 0.0 <= value <= 1.0:
        raise fields.error(name, f"is {value:g}, not between 0 and 1")
    return value


def _port(link: Fields, name: str, ports: Mapping[int, float]) -> float:
    number = link.required_integer(name)
    if number not in ports:
        raise link.error(name, f"names port {number}, which the veglenkesekvens does not have")
    return ports[number]


def _date(fields: Fields, name: str) -> date | None:
    text = fields.text(name)
    if text is None:
        return None
    try:
        return date.fromisoformat(text[:10])
    except ValueError as error:
        raise fields.error(name, f"is {text[:40]!r} instead of a date") from error


def _line(geometri: Fields) -> LineString:
    """Read a link's WKT: UTM33 only, because that is what positions along it are defined in."""
    import shapely

    wkt = geometri.text("wkt")
    if wkt is None:
        raise geometri.error("wkt", "is missing")
    srid = geometri.integer("srid")
    if srid not in _UTM33:
        raise geometri.error("srid", f"is {srid} instead of 5973: ask for srid=5973")
    try:
        line = shapely.from_wkt(wkt)
    except shapely.GEOSException as error:
        raise geometri.error("wkt", f"is not readable WKT ({wkt[:40]!r})") from error
    if not isinstance(line, shapely.LineString) or line.is_empty:
        raise geometri.error("wkt", f"is not a line ({wkt[:40]!r})")
    west, south, east, north = line.bounds
    if not (in_norway(west, south) and in_norway(east, north)):
        raise geometri.error("wkt", f"lies outside Norway ({wkt[:60]!r})")
    return line


def _vegreferanse(fields: Fields) -> Vegreferanse | None:
    """None for a link without a road reference, which comes as an empty object."""
    kortform = fields.text("kortform")
    if not kortform:
        return None
    system = fields.child("vegsystem")
    parts = (fields.child(name) for name in ("kryssystem", "sideanlegg", "strekning"))
    part = next((part for part in parts if part.raw), Fields({}, ""))
    retning = part.text("retning") or ""
    if retning not in {"", "MED", "MOT"}:
        raise part.error("retning", f"is {retning[:20]!r} instead of MED or MOT")
    return Vegreferanse(
        kortform=kortform,
        vegkategori=system.text("vegkategori") or "",
        fase=system.text("fase") or "",
        nummer=system.integer("nummer"),
        trafikantgruppe=part.text("trafikantgruppe") or "",
        retning=retning,
        fra_meter=part.number("fra_meter"),
        til_meter=part.number("til_meter"),
    )
