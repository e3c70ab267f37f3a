"""Change sets for NVDB API Skriv V3: the document, its XML and JSON, its checks, its builders, its undoing.

>>> from nvdb.endringssett import Target, endringssett, gone, to_xml, validate
"""

from __future__ import annotations

from nvdb.endringssett.build import (
    changed_type,
    gone,
    moved,
    new_plates,
    new_sign,
    position_correction,
    skiltnummer_enum,
)
from nvdb.endringssett.document import (
    MAX_VEGOBJEKTER,
    Assosiasjon,
    Datter,
    Egenskap,
    Endring,
    Endringssett,
    Geometri,
    Kvalitet,
    Punkt,
    Stedfesting,
    endringssett,
)
from nvdb.endringssett.finding import ADVARSEL, FEIL, ValidationFinding
from nvdb.endringssett.inverse import Earlier, earlier_from_vegobjekt, inverse
from nvdb.endringssett.json import from_json, to_json
from nvdb.endringssett.measured import (
    Measured,
    NewPlate,
    NewPoint,
    Target,
    punkt_from_stedfesting,
    target_from_skilt,
)
from nvdb.endringssett.validate import errors, validate
from nvdb.endringssett.xml import from_xml, to_xml

__all__ = [
    "ADVARSEL",
    "FEIL",
    "MAX_VEGOBJEKTER",
    "Assosiasjon",
    "Datter",
    "Earlier",
    "Egenskap",
    "Endring",
    "Endringssett",
    "Geometri",
    "Kvalitet",
    "Measured",
    "NewPlate",
    "NewPoint",
    "Punkt",
    "Stedfesting",
    "Target",
    "ValidationFinding",
    "changed_type",
    "earlier_from_vegobjekt",
    "endringssett",
    "errors",
    "from_json",
    "from_xml",
    "gone",
    "inverse",
    "moved",
    "new_plates",
    "new_sign",
    "position_correction",
    "punkt_from_stedfesting",
    "skiltnummer_enum",
    "target_from_skilt",
    "to_json",
    "to_xml",
    "validate",
]
