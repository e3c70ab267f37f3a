"""Links of a road network, as API Les V4 writes them."""

from __future__ import annotations

from typing import Any

Raw = dict[str, Any]


def segment(sekvens: int, coordinates: str, retning: str = "MED", **changes: Any) -> Raw:
    """A link in V4's form, 0 to 1 of its veglenkesekvens, on a road for cars."""
    return {
        "veglenkesekvensid": sekvens,
        "veglenkenummer": 1,
        "segmentnummer": 1,
        "referanse": f"{sekvens}-1-1",
        "metadata": {"startdato": "2015-03-01"},
        "startposisjon": 0,
        "sluttposisjon": 1,
        "type": "HOVED",
        "detaljnivå": "Vegtrase og kjørebane",
        "topologinivå": "Vegtrase",
        "typeVeg_sosi": "enkelBilveg",
        "geometri": {"wkt": f"LINESTRING Z({coordinates})", "srid": 5973},
        "kommune": 5001,
        "vegsystemreferanse": {
            "vegsystem": {"vegkategori": "F", "fase": "V", "nummer": 6690},
            "strekning": {
                "strekning": 1,
                "delstrekning": 1,
                "trafikantgruppe": "K",
                "retning": retning,
                "fra_meter": 100.0,
                "til_meter": 598.5,
            },
            "kortform": "FV6690 S1D1 m100-599",
        },
        **changes,
    }


def link_in_oslo(number: int, **changes: Any) -> Raw:
    """Link `number` without a road reference, 10 m north; each lies 1 km further east than the one before."""
    east = 260_000 + 1000 * number
    bare: Raw = {"metadata": {"startdato": "2020-01-01"}, "kommune": 301, "vegsystemreferanse": {}}
    return segment(5000 + number, f"{east} 6650000 1, {east} 6650010 1", **(bare | changes))
