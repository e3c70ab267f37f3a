"""The road network (vegnett): links, and where along them a point lies (stedfesting).

>>> from nvdb.vegnett import Vegnett, hent_vegnett, stedfester
>>> nett = Vegnett.from_les_v4(link for page in hent_vegnett(client, area) for link in page.objects)
>>> places = stedfester(nett, on_date=date(2026, 5, 4)).stedfest(east, north)

The page ``docs/vegnett.md`` explains what is computed and how it was checked.
"""

from nvdb.vegnett.hent import SEGMENTERT, hent_vegnett
from nvdb.vegnett.nett import BILVEG, Vegnett
from nvdb.vegnett.polylinjer import Polylinjer
from nvdb.vegnett.retning import facing_azimuth, true_azimuth
from nvdb.vegnett.stedfest import ON_THE_LINE_M, Stedfester, Stedfestinger, stedfester
from nvdb.vegnett.veglenke import Veglenke, Vegreferanse, veglenke_from_les_v4, veglenker_from_uberiket

__all__ = [
    "BILVEG",
    "ON_THE_LINE_M",
    "SEGMENTERT",
    "Polylinjer",
    "Stedfester",
    "Stedfestinger",
    "Veglenke",
    "Vegnett",
    "Vegreferanse",
    "facing_azimuth",
    "hent_vegnett",
    "stedfester",
    "true_azimuth",
    "veglenke_from_les_v4",
    "veglenker_from_uberiket",
]
