"""Where signs lie on the road network of the store."""

from __future__ import annotations

import datetime as dt
from functools import cache

from nvdb.endringssett import Punkt
from nvdb.errors import RequestError
from nvdb.vegnett import BILVEG, Stedfester, Vegnett
from twin.store import Store
from twin.vegnett import load_vegnett
from twin.vegnett.network import FACT


class Places:
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
        return self._nett().stedfester(on_date=day, type_veg=BILVEG)

    def place(self, east_m: float, north_m: float, day: dt.date, before: Punkt | None = None) -> Punkt:
        """Place one point.

        Parameters
        ----------
        east_m, north_m : float
            EPSG:25833.
        day : date
        before : Punkt, optional
            Where it was: on the same veglenkesekvens its direction and lanes stay, and its side where the
            centre line tells none.

        Raises
        ------
        RequestError
            The store has no network, or no road is near.
        """
        found = self._stedfester(day).stedfest([east_m], [north_m])
        if not found.found[0]:
            raise RequestError(
                f"it has no place on the road network ({found.reason[0]}): look there, or sync a larger area"
            )
        sekvens = int(found.veglenkesekvensid[0])
        same = before if before is not None and before.veglenkesekvens_id == sekvens else None
        return Punkt(
            veglenkesekvens_id=sekvens,
            posisjon=float(found.relativ_posisjon[0]),
            retning=same.retning if same else None,
            sideposisjon=str(found.sideposisjon[0]) or (same.sideposisjon if same else None),
            kjorefelt=same.kjorefelt if same else (),
        )
