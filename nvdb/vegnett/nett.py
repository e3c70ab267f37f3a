"""Vegnett: the road network of an area, in columns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from datetime import UTC, date, datetime
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from nvdb.errors import SchemaError
from nvdb.vegnett.veglenke import (
    RawObject,
    Veglenke,
    Vegreferanse,
    veglenke_from_les_v4,
    veglenker_from_uberiket,
)

BILVEG: Final = frozenset({"enkelBilveg", "kanalisertVeg", "rampe", "rundkjøring"})
"""Roads for cars, by SOSI name: neither ferries nor ways for walking and cycling."""

_NO_REFERENCE = Vegreferanse("")
_RETNING = {"MED": 1, "MOT": -1, "": 0}


@dataclass(frozen=True, slots=True, eq=False)
class Vegnett:
    """Links in columns of length n, sorted by veglenkesekvens, position, number and start of validity.

    Links that are no longer valid are kept; :meth:`valid` says which are.

    Attributes
    ----------
    veglenkesekvensid, veglenkenummer, segmentnummer : int64 arrays
    startposisjon, sluttposisjon : float64 arrays
        Relative positions along the veglenkesekvens.
    geometri : object array of shapely.LineString
        EPSG:25833 and NN2000, in the direction of growing position.
    startdato, sluttdato : datetime64[D] arrays
        Half-open period; `sluttdato` is NaT where no end is known.
    konnektering, detaljert : bool arrays
    type_veg, detaljniva, vegkategori, trafikantgruppe, kortform : object arrays of str
        Empty where not known. `kortform` is that of the whole link: ``EV18 S53D1 m2922-3041``.
    retning : int64 array
        1 where the link runs with the metering (MED), -1 against it (MOT), 0 unknown.
    fra_meter, til_meter : float64 arrays
        Lowest and highest meter value; NaN where not known.
    rejected : tuple of str
        One sentence for each link that could not be read and is left out.
    """

    veglenkesekvensid: NDArray[np.int64]
    veglenkenummer: NDArray[np.int64]
    segmentnummer: NDArray[np.int64]
    startposisjon: NDArray[np.float64]
    sluttposisjon: NDArray[np.float64]
    geometri: NDArray[np.object_]
    startdato: NDArray[np.datetime64]
    sluttdato: NDArray[np.datetime64]
    konnektering: NDArray[np.bool_]
    detaljert: NDArray[np.bool_]
    type_veg: NDArray[np.object_]
    detaljniva: NDArray[np.object_]
    vegkategori: NDArray[np.object_]
    trafikantgruppe: NDArray[np.object_]
    kortform: NDArray[np.object_]
    retning: NDArray[np.int64]
    fra_meter: NDArray[np.float64]
    til_meter: NDArray[np.float64]
    rejected: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        lengths = {len(getattr(self, column)) for column in _COLUMNS}
        if len(lengths) > 1:
            msg = f"The columns of a Vegnett have {sorted(lengths)} rows: give all the same number."
            raise ValueError(msg)
        # Ties between links are broken by row, so rows must not depend on the order of arrival.
        order = np.lexsort(
            (
                self.startdato,
                self.segmentnummer,
                self.veglenkenummer,
                self.startposisjon,
                self.veglenkesekvensid,
            )
        )
        if not np.array_equal(order, np.arange(len(self))):
            for column in _COLUMNS:
                object.__setattr__(self, column, getattr(self, column)[order])

    def __len__(self) -> int:
        return len(self.veglenkesekvensid)

    @classmethod
    def from_veglenker(cls, veglenker: Iterable[Veglenke], rejected: Iterable[str] = ()) -> Vegnett:
        """Put links into columns."""
        links = list(veglenker)
        references = [link.referanse or _NO_REFERENCE for link in links]
        return cls(
            veglenkesekvensid=np.array([link.veglenkesekvensid for link in links], dtype=np.int64),
            veglenkenummer=np.array([link.veglenkenummer for link in links], dtype=np.int64),
            segmentnummer=np.array([link.segmentnummer for link in links], dtype=np.int64),
            startposisjon=np.array([link.startposisjon for link in links], dtype=np.float64),
            sluttposisjon=np.array([link.sluttposisjon for link in links], dtype=np.float64),
            geometri=_objects([link.geometri for link in links]),
            startdato=np.array([link.startdato for link in links], dtype="datetime64[D]"),
            sluttdato=np.array([link.sluttdato for link in links], dtype="datetime64[D]"),
            konnektering=np.array([link.konnektering for link in links], dtype=np.bool_),
            detaljert=np.array([link.detaljert for link in links], dtype=np.bool_),
            type_veg=_objects([link.type_veg for link in links]),
            detaljniva=_objects([link.detaljniva for link in links]),
            vegkategori=_objects([reference.vegkategori for reference in references]),
            trafikantgruppe=_objects([reference.trafikantgruppe for reference in references]),
            kortform=_objects([reference.kortform for reference in references]),
            retning=np.array([_RETNING[reference.retning] for reference in references], dtype=np.int64),
            fra_meter=np.array([reference.fra_meter for reference in references], dtype=np.float64),
            til_meter=np.array([reference.til_meter for reference in references], dtype=np.float64),
            rejected=tuple(rejected),
        )

    @classmethod
    def from_les_v4(cls, objects: Iterable[RawObject]) -> Vegnett:
        """Read links of ``/veglenkesekvenser/segmentert``; unreadable ones go to `rejected`."""
        links: list[Veglenke] = []
        rejected: list[str] = []
        for raw in objects:
            try:
                links.append(veglenke_from_les_v4(raw))
            except SchemaError as error:
                rejected.append(str(error))
        return cls.from_veglenker(links, rejected)

    @classmethod
    def from_uberiket(cls, veglenkesekvenser: Iterable[RawObject]) -> Vegnett:
        """Read veglenkesekvenser of Uberiket; one with an unreadable link is left out whole.

        Uberiket knows no road reference: `kortform` is empty and the metering direction unknown throughout.
        """
        links: list[Veglenke] = []
        rejected: list[str] = []
        for raw in veglenkesekvenser:
            try:
                links.extend(list(veglenker_from_uberiket(raw)))
            except SchemaError as error:
                rejected.append(str(error))
        return cls.from_veglenker(links, rejected)

    def valid(self, on_date: date | None = None) -> NDArray[np.bool_]:
        """Which links are valid on a day (today if left out), as a mask of length n."""
        day = np.datetime64(on_date or datetime.now(UTC).date(), "D")
        ended = ~np.isnat(self.sluttdato) & (self.sluttdato <= day)
        return (self.startdato <= day) & ~ended


_COLUMNS = tuple(column.name for column in fields(Vegnett) if column.name != "rejected")


def _objects(values: list[Any]) -> NDArray[np.object_]:
    column = np.empty(len(values), dtype=np.object_)
    column[:] = values
    return column
