"""What QGIS shows when the mouse rests on a feature: HTML with a short notation for fields.

====================  =====================================================================
``{reason}``          the text of a field, safe in HTML; "–" where it is empty
``{distance_m:2 m}``  a number with two decimals and its unit; "–" where it is null
``{first_seen:time}`` a moment, to the second; "–" where it is null
``{= expression}``    the value of a QGIS expression
====================  =====================================================================
"""

from __future__ import annotations

import re

MAP_TIPS: dict[str, str] = {
    "changes": """
<b>{= represent_value("verdict") }</b> &nbsp; NVDB: {skiltnummer_nvdb}, seen: {skiltnummer_seen}
<br>Distance {distance_m:2 m} ± {distance_sigma_m:2 m}, confidence {confidence:2}
<br>{reason}
<br><small>Decision: {= represent_value("decision") }</small>
""",
    "moves": """
<b>{= represent_value("verdict") }</b> &nbsp; {distance_m:2 m} ± {distance_sigma_m:2 m} from NVDB's position
<br><small>Change {change_id}</small>
""",
    "ellipses": """
95 % ellipse of object <b>{object}</b>
<br>σ {sigma_major_m:2 m} × {sigma_minor_m:2 m}, CEP95 {cep95_m:2 m}
""",
    "estimates": """
<b>{skiltnummer}</b> &nbsp; object {object}, drive {drive_id}
<br>{n_sightings:0} sightings in {n_frames:0} frames of {n_cameras:0} cameras, nearest {range_min_m:1 m}
<br>{first_seen:time} UTC
<br>σ {sigma_major_m:2 m} × {sigma_minor_m:2 m}, CEP95 {cep95_m:2 m}
<br><small>Flags: {flags}</small>
""",
    "nvdb_signs": """
<b>{= represent_value("nvdb_type") } {= "nvdb_id" }</b> version {version:0}
<br>{skiltnummer} &nbsp; {text}
<br>{road_reference}
<br>{= if("own_geometry", 'Has its own geometry', 'On the line of the road: no geometry of its own') },
stated accuracy {accuracy_cm:0 cm}
<br><small>Last modified {last_modified}, fetched {synced_at}</small>
""",
    "drives": """
<b>{name}</b> &nbsp; {drive_id}
<br>{started:time} – {ended:time} UTC, {length_m:0 m}
<br>{n_sightings:0} sightings in {n_frames:0} frames,
{= if("annotations_complete", 'every sign in view annotated', 'not every sign in view annotated') }
""",
}

_FIELD = re.compile(
    r"\{(?:=\s*(?P<raw>[^{}]+?)\s*|(?P<name>\w+)(?::(?:(?P<digits>\d)(?P<unit> \w+)?|time))?)\}"
)


def map_tip(layer: str) -> str:
    """HTML template of a layer, with QGIS expressions in ``[% %]``."""
    return _FIELD.sub(lambda field: f"[% {_expression(field)} %]", MAP_TIPS[layer].strip())


def _expression(field: re.Match[str]) -> str:
    if field["raw"]:
        return field["raw"]
    name = f'"{field["name"]}"'
    if field["digits"]:
        # No format_number(): it follows the computer's language and would group the digits of a thousand.
        shown = f"to_string(round({name}, {field['digits']})) || '{field['unit'] or ''}'"
    elif field[0].endswith(":time}"):
        shown = f"format_date({name}, 'yyyy-MM-dd HH:mm:ss')"
    else:
        # Reasons and texts on signs may hold "<" and "&".
        shown = f"nullif(replace(replace({name}, '&', '&amp;'), '<', '&lt;'), '')"
    return f"coalesce({shown}, '–')"
