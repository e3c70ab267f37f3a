"""Objects of NVDB as frozen records: Vegobjekt, Skiltpunkt, Skiltplate, geometry, read from its answers."""

from nvdb.objects.geometri import (
    NORWAY_UTM33,
    Position,
    PositionError,
    PositionFault,
    in_norway,
    point_from_wkt,
    position_from_wkt,
)
from nvdb.objects.les_v4 import skilt_from_les_v4, vegobjekt_from_les_v4
from nvdb.objects.skilt import Skiltplate, Skiltpunkt, skilt_from_vegobjekt
from nvdb.objects.uberiket import skilt_from_uberiket, vegobjekt_from_uberiket
from nvdb.objects.vegobjekt import GeometriKvalitet, Relasjon, Vegobjekt, VegobjektStedfesting

__all__ = [
    "NORWAY_UTM33",
    "GeometriKvalitet",
    "Position",
    "PositionError",
    "PositionFault",
    "Relasjon",
    "Skiltplate",
    "Skiltpunkt",
    "Vegobjekt",
    "VegobjektStedfesting",
    "in_norway",
    "point_from_wkt",
    "position_from_wkt",
    "skilt_from_les_v4",
    "skilt_from_uberiket",
    "skilt_from_vegobjekt",
    "vegobjekt_from_les_v4",
    "vegobjekt_from_uberiket",
]
