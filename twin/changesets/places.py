"""Where signs lie on the road network of the store."""

from __future__ import annotations

import datetime as dt
import math
from functools import cache

from nvdb.datakatalog import Ansiktsside
from nvdb.endringssett import Punkt
from nvdb.errors import RequestError
from nvdb.vegnett import BILVEG, Stedfester, Stedfestinger, Vegnett, stedfester
from twin.mirror.vegnett import load_vegnett
from twin.mirror.vegnett.network import FACT
from twin.store.store import Store


class RoadPlaces:
    """Places points on the roads for cars that were valid on the day of the drive.

    The network is read when the first point is placed: most change sets need none.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._nett = cache(self._load)
        self._stedfester = cache(self._index)

    def _load(self) -> Vegnett:
        if self._store.fact(FACT) is None:
            raise RequestError(
                "it needs a place on the road network, which the store does not have: run `twin sync-nvdb "
                "--vegnett`, then `twin match`"
            )
        return load_vegnett(self._store)

    def _index(self, day: dt.date) -> Stedfester:
        return stedfester(self._nett(), on_date=day, type_veg=BILVEG)

    def place(
        self,
        east_m: float,
        north_m: float,
        day: dt.date,
        *,
        face_deg: float | None = None,
        before: Punkt | None = None,
    ) -> Punkt:
        """Place one point.

        Parameters
        ----------
        east_m, north_m : float
            EPSG:25833.
        day : date
        face_deg : float, optional
            Azimuth from grid north that the sign looks towards: it is for traffic the other way, whose
            direction along the veglenkesekvens becomes the place's. None without one.
        before : Punkt, optional
            Where it was: on the same veglenkesekvens its direction and lanes stay, and its side where the
            centre line tells none.

        Raises
        ------
        RequestError
            The store has no network, or no road is near.
        """
        found = self._beside(east_m, north_m, day)
        sekvens = int(found.veglenkesekvensid[0])
        same = before if before is not None and before.veglenkesekvens_id == sekvens else None
        along = _along(face_deg, float(found.link_azimuth_grid_deg[0]))
        return Punkt(
            veglenkesekvens_id=sekvens,
            posisjon=float(found.relativ_posisjon[0]),
            retning=(same.retning if same else None) or {True: "MED", False: "MOT", None: None}[along],
            sideposisjon=str(found.sideposisjon[0]) or (same.sideposisjon if same else None),
            kjorefelt=same.kjorefelt if same else (),
        )

    def ansiktsside(
        self, east_m: float, north_m: float, day: dt.date, face_deg: float | None
    ) -> Ansiktsside | None:
        """Say which traffic a plate is for; None where it stands along the road, or either is not known.

        Raises
        ------
        RequestError
            As :meth:`place`.
        """
        found = self._beside(east_m, north_m, day)
        along = _along(face_deg, float(found.metering_azimuth_grid_deg[0]))
        if along is None:
            return None
        return Ansiktsside.MED_METRERINGSRETNING if along else Ansiktsside.MOT_METRERINGSRETNING

    def _beside(self, east_m: float, north_m: float, day: dt.date) -> Stedfestinger:
        found = self._stedfester(day).stedfest([east_m], [north_m])
        if not found.found[0]:
            raise RequestError(
                f"it has no place on the road network ({found.reason[0]}): look there, or sync a larger area"
            )
        return found


_ALONG = math.cos(math.radians(60.0))
"""A plate that looks more than 60° away from the road's axis is for nobody who follows the road."""


def _along(face_deg: float | None, axis_deg: float) -> bool | None:
    """Whether the traffic that reads a face drives along an axis (True) or against it; None if unclear."""
    if face_deg is None or math.isnan(axis_deg):
        return None
    along = -math.cos(math.radians(face_deg - axis_deg))
    return along > 0 if abs(along) >= _ALONG else None
