"""Layers as a small drive gives them: every verdict once, plates that share a pole, nulls, odd characters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import geopandas as gpd
import numpy as np
import pandas as pd
import pytest
from shapely import LineString, Point

from twin.belief import State
from twin.store.kinds import Verdict

if TYPE_CHECKING:
    from twin.export import ExportLayers

EAST, NORTH = 270_000.0, 7_041_000.0
"""In Trondheim, EPSG:25833."""
VERDICTS = tuple(Verdict)


def _changes() -> gpd.GeoDataFrame:
    n = len(VERDICTS)
    at = [Point(EAST + 40.0 * i, NORTH + 12.0 * np.sin(i)) for i in range(n)]
    seen = [verdict not in {Verdict.MISSING, Verdict.NOT_OBSERVABLE} for verdict in VERDICTS]
    known = [verdict != Verdict.NEW for verdict in VERDICTS]
    return gpd.GeoDataFrame(
        {
            "change_id": [f"c-{i:02d}" for i in range(n)],
            "verdict": VERDICTS,
            "reason": [f'Skjærgårdsveien <{verdict}> & "so" on' for verdict in VERDICTS],
            "confidence": np.linspace(0.5, 0.99, n),
            "nvdb_type": [96, 95, 96, 96, 96, 96, 95],
            "nvdb_id": pd.array(
                [900_000_000 + i if ok else None for i, ok in enumerate(known)], dtype="Int64"
            ),
            "nvdb_version": pd.array([1 if ok else None for ok in known], dtype="Int64"),
            "skiltnummer_nvdb": ["362.50" if ok else "" for ok in known],
            "skiltnummer_seen": ["362.60" if ok else "" for ok in seen],
            "distance_m": [0.25 if s and k else np.nan for s, k in zip(seen, known, strict=True)],
            "distance_sigma_m": [0.4 if s and k else np.nan for s, k in zip(seen, known, strict=True)],
            "drive_ids": "0123456789ab,ba9876543210",
            "n_sightings": range(n),
            "decision": ["open"] * (n - 1) + ["defer"],
            "cameras": ["C1_tricam60,C3_tricam120"] * (n - 1) + [""],
            "synced_at": "2026-06-01T12:00:00Z",
            "software": "nvdb-twin 0.1.0",
            "config_sha256": "ab" * 32,
            "sign": "362.60 – Fartsgrense, 60 km/t",
            "road": "EV6 S1D1 m100, Skjærgårdsveien",
            "comment": [""] * (n - 1) + ["Look <again>"],
            "author": [""] * (n - 1) + ["kari"],
            "crop_face": "",
            "crop_wide": "",
        },
        geometry=at,
        crs=25833,
    )


def _estimates() -> gpd.GeoDataFrame:
    n = 5
    moment = pd.Timestamp("2026-06-10T08:00:00.125Z") + pd.to_timedelta(np.arange(n), unit="s")
    return gpd.GeoDataFrame(
        {
            "estimate_id": [f"e-{i}" for i in range(n)],
            "drive_id": "0123456789ab",
            "object": [str(i) for i in range(n)],
            "label": "skilt",
            "skiltnummer": "362.60",
            "nvdb_type": 95,
            "method": "single-frame",
            "n_sightings": 9,
            "n_frames": 8,
            "n_cameras": 2,
            "first_seen": moment,
            "last_seen": moment + pd.Timedelta(seconds=2),
            "range_min_m": 7.5,
            "height_m": 65.7,
            "height_nn2000_m": [26.3, np.nan, 26.3, 26.3, 26.3],
            "sigma_major_m": 0.5,
            "sigma_minor_m": 0.2,
            "sigma_azimuth_deg": 30.0,
            "cep95_m": 1.0,
            "flags": ["", "few_sightings", "", "", ""],
            "sigma_height_m": [0.05, np.nan, 0.05, 0.05, 0.05],
            "sigma_east_m": 0.3,
            "sigma_north_m": 0.45,
            "correlation": 0.7,
        },
        geometry=[Point(EAST + 40.0 * i + 0.3, NORTH + 12.0 * np.sin(i) + 0.2) for i in range(n)],
        crs=25833,
    )


def _nvdb_signs() -> gpd.GeoDataFrame:
    n = 6
    return gpd.GeoDataFrame(
        {
            "nvdb_id": 900_000_000 + np.arange(n),
            "nvdb_type": [95, 96, 96, 96, 96, 96],
            "version": pd.array([1, 2, None, 1, 1, 1], dtype="Int64"),
            "point_id": pd.array([None, 900_000_000, None, None, None, None], dtype="Int64"),
            "skiltnummer": ["", "362.50", "202", "204", "366", "372"],
            "text": ["", "50", "", "", "", "Ålesund < Tromsø"],
            "own_geometry": [True, True, True, True, False, True],
            "accuracy_cm": [10.0, np.nan, 3.0, 3.0, np.nan, 10.0],
            "capture_method": "",
            "road_reference": "EV6 S1D1 m100",
            "ansiktsside": "Med metreringsretning",
            "last_modified": "2024-03-01T10:00:00",
            "synced_at": "2026-06-11T09:30:00Z",
        },
        geometry=[Point(EAST + 40.0 * i, NORTH + 12.0 * np.sin(i)) for i in range(n - 1)] + [None],
        crs=25833,
    )


def _drives() -> gpd.GeoDataFrame:
    along = np.arange(0.0, 250.0, 5.0)
    line = LineString(np.column_stack([EAST + along, NORTH + 12.0 * np.sin(along / 40.0) - 4.0]))
    return gpd.GeoDataFrame(
        {
            "drive_id": ["0123456789ab"],
            "name": ["Trondheim"],
            "started": [pd.Timestamp("2026-06-10T08:00:00Z")],
            "ended": [pd.Timestamp("2026-06-10T08:01:00.5Z")],
            "n_frames": [1800],
            "n_sightings": [45],
            "annotations_complete": [True],
            "datum": ["EUREF89"],
            "length_m": [250.0],
        },
        geometry=[line],
        crs=25833,
    )


def _belief() -> gpd.GeoDataFrame:
    states = list(State)
    n = len(states)
    seen = [pd.Timestamp("2026-06-10T08:00:30Z")] * (n - 1) + [pd.NaT]
    return gpd.GeoDataFrame(
        {
            "place_id": [f"95:{900_000_000 + i}" for i in range(n - 1)] + ["0123456789ab:P<9>"],
            "nvdb_type": pd.array([95] * (n - 1) + [None], dtype="Int64"),
            "nvdb_id": pd.array([*range(900_000_000, 900_000_000 + n - 1), None], dtype="Int64"),
            "skiltnummer": "362.50;142",
            "state": states,
            "p_stands": np.linspace(0.99, 0.01, n),
            "unsure_bits": 0.5,
            "last_seen": pd.Series(seen, dtype="datetime64[ms, UTC]"),
            "last_passed": pd.Series(seen, dtype="datetime64[ms, UTC]"),
            "n_seen": 2,
            "n_missed": range(n),
            "verdict": [""] * n,
            "road": "EV6 S1D1 m100",
            "kommune": "5001",
        },
        geometry=[Point(EAST + 40.0 * i, NORTH + 12.0 * np.sin(i)) for i in range(n)],
        crs=25833,
    )


def _roads_to_drive() -> gpd.GeoDataFrame:
    bits = [12.0, 2.0, 0.1]
    return gpd.GeoDataFrame(
        {
            "road_id": [f"FV{k} S1D1 5001" for k in range(3)],
            "road": [f"FV{k} S1D1" for k in range(3)],
            "kommune": "5001",
            "km": 2.0,
            "n_places": 9,
            "n_unsure": 2,
            "n_not_passed": 1,
            "unsure_bits": 30.0,
            "settled_bits": bits,
            "settled_bits_per_km": [each / 2 for each in bits],
        },
        geometry=[LineString([(EAST, NORTH + 9 * k), (EAST + 90, NORTH + 9 * k)]) for k in range(3)],
        crs=25833,
    )


@pytest.fixture(scope="session")
def layers() -> ExportLayers:
    """Return a small, complete set of layers, which no test changes."""
    from twin.export import ExportLayers

    return ExportLayers(_changes(), _estimates(), _nvdb_signs(), _drives(), _belief(), _roads_to_drive())
