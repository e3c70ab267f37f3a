"""Property and enum ids of Skiltpunkt (95) and Skiltplate (96): the constants that the code reasons with."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Final

SKILTPUNKT: Final = 95
"""Vegobjekttype: what a sign stands on, and where."""
SKILTPLATE: Final = 96
"""Vegobjekttype: one plate with one motive."""
VARIABELT_SKILT: Final = 97

GEOMETRI_PUNKT_95: Final = 4794
GEOMETRI_PUNKT_96: Final = 4795
GEOMETRI_PUNKT: Final[Mapping[int, int]] = {SKILTPUNKT: GEOMETRI_PUNKT_95, SKILTPLATE: GEOMETRI_PUNKT_96}
"""Vegobjekttype → the property that holds the object's own point."""

OPPSETTINGSUTSTYR: Final = 1876
AVSTAND_FRA_DEKKEKANT: Final = 1884
HOYDE_OVER_VEGKANT: Final = 2055

SKILTNUMMER: Final = 5530
TEKST: Final = 1910
PLASSERINGSKODE: Final = 5128
ANSIKTSSIDE: Final = 1894

SKILTPLATER_I_SKILTPUNKT: Final = 220004
"""Relation 95 → 96 (the list; its members are 200004)."""

EGENSKAPER_95: Final[Mapping[int, str]] = {
    1876: "Oppsettingsutstyr",
    1877: "Antall oppsettingsutstyr",
    10428: "Høyde mast/stolpe (m)",
    2055: "Høyde over vegkant (m)",
    1884: "Avstand fra dekkekant (m)",
    8772: "Avskjæringsledd",
    1671: "Fundamentering",
    10854: "Tilleggsinformasjon",
    11078: "Prosjektreferanse",
    12318: "ProsjektInternObjekt_ID",
    7999: "Eier",
    8063: "Vedlikeholdsansvarlig",
    4794: "Geometri, punkt",
}

EGENSKAPER_96: Final[Mapping[int, str]] = {
    5530: "Skiltnummer",
    1910: "Tekst",
    5128: "Plasseringskode",
    1894: "Ansiktsside, rettet mot",
    9484: "Tosidig plate med ulike motiv",
    1897: "Himmelretning",
    1970: "Størrelse",
    1588: "Høyde, egen (mm)",
    1328: "Bredde, målt (mm)",
    1892: "Skiltform",
    1912: "Tekst-/Symbolhøyde (mm)",
    1294: "Farge",
    1879: "Belysning",
    1921: "Folieklasse",
    8828: "Klappskilt",
    1890: "Vedtaksnummer",
    2108: "Oppsettingsdato",
    2107: "Skiftet dato",
    10479: "Driftsmerking",
    11861: "Produktnavn",
    1494: "Leverandør",
    11536: "Tilleggsinformasjon",
    9154: "Arkivnummer",
    11079: "Prosjektreferanse",
    12319: "ProsjektInternObjekt_ID",
    11826: "Eier",
    8064: "Vedlikeholdsansvarlig",
    4795: "Geometri, punkt",
}


class Ansiktsside(IntEnum):
    """Enum ids of 1894 *Ansiktsside, rettet mot*: the traffic that the face is for."""

    MED_METRERINGSRETNING = 2714
    MOT_METRERINGSRETNING = 2717
    PARALLELT_MOT_VEG = 2837
    PARALLELT_FRA_VEG = 2838
    TOSIDIG = 3698


SKILTNUMMER_ENUM: Final[Mapping[str, int]] = {
    # fareskilt
    "108": 7610, "142": 7633, "146.1": 8867,
    # vikeplikt- og forkjørsskilt
    "202": 7642, "204": 7643,
    # forbudsskilt
    "302": 7649, "306.3": 7652, "306.6": 7655, "306.7": 7656, "306.8": 7657, "306.9": 7658, "308": 9152,
    "310": 10079, "312": 7659, "314": 7660, "316": 7661, "318.1": 7662, "318.2": 7663, "320": 7664,
    "322": 7665, "324.1": 7666, "324.2": 9776, "326": 7667, "330.1": 7668, "330.2": 7669, "332": 7670,
    "334": 7671, "335": 9153, "336": 7672, "337": 9154, "362.20": 11578, "362.30": 8872, "362.40": 8873,
    "362.50": 8874, "362.60": 8875, "362.70": 8876, "362.80": 8877, "362.90": 8878, "362.100": 8879,
    "362.110": 11816, "364.20": 12146, "364.30": 9155, "364.40": 9156, "364.50": 9157, "364.60": 9158,
    "364.70": 9159, "366": 7675, "367": 21392, "368": 7676, "369": 21393, "370": 7677, "372": 7678,
    "376.1": 7679, "376.2": 7680, "377": 21394, "378.1": 7681, "378.2": 7682, "379": 21395,
    "380": 21396, "382": 21397,
    # påbudsskilt
    "402.1": 7683, "402.2": 7684, "402.3": 7685, "402.4": 7686, "402.5": 7687, "402.6": 7688,
    "402.7": 7689, "402.8": 7690, "404.1": 7691, "404.2": 7692, "406": 7693, "408": 17312,
    # opplysningsskilt
    "502": 9160, "503": 9161, "504": 9162, "505": 9163, "506": 17313, "507": 17314, "508.1": 7699,
    "508.2": 7700, "509": 9164, "510.1": 7701, "510.2": 7702, "511": 9165, "512": 7703, "513": 9166,
    "514": 7704, "516": 7705, "518": 7706, "520": 7707, "521": 9167, "521.2": 13465, "522": 7708,
    "524": 7709, "526.1": 7710, "526.2": 7711, "527.1": 9168, "527.2": 9169, "528": 7712, "530.01": 7713,
    "530.11": 7714, "532.H03": 8916, "536.102": 8939, "560.2": 12147,
    # serviceskilt, vegvisningsskilt, underskilt, markeringsskilt
    "600": 9179, "701.1": 7760, "711.R": 9198, "711.V90": 12120, "711.H90": 12118, "711.V135": 16049,
    "711.H135": 16052, "713.H": 12121, "713.V": 9199, "727.1": 7756, "727.3F": 12151, "727.3K": 9382,
    "802": 7781, "808.105": 7798, "810.H90": 9250, "906V": 7842, "906H": 7843, "912": 7846,
    # retired codes that objects still carry
    "U324": 9945, "U544": 7726, "U546": 7727, "U721.1": 7762, "U721.2": 7763, "U722.2": 7765,
    "U722.3": 7766, "U999": 9358,
}  # fmt: skip
"""Sign code → enum id of 5530 *Skiltnummer*, for the common signs: 130 of 642."""
