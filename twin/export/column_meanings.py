"""What the columns of the layers say: ``make reference`` writes docs/reference/layers.md from it."""

from __future__ import annotations

from collections.abc import Mapping

_CHANGE_ID = "the finding: the same one has the same id in every run"
_VERDICT = "unchanged, moved, wrong_type, new, missing, not_observable or review"
_DISTANCE = "from NVDB's position to the measured one"
_SYNCED = "when NVDB's word on it was fetched, UTC"
_OBJECT = "the annotator's or tracker's id of the object"
_MAJOR = "long half axis of the error ellipse, one sigma"
_MINOR = "short half axis, likewise"
_CEP = "radius of the circle that holds the truth with 95 % probability"

MEANINGS: Mapping[str, Mapping[str, str]] = {
    "changes": {
        "change_id": _CHANGE_ID,
        "verdict": _VERDICT,
        "reason": "one sentence, in the export's language",
        "confidence": "probability that the verdict is right: twin help matching",
        "nvdb_type": "95 Skiltpunkt or 96 Skiltplate",
        "nvdb_id": "NVDB's object; null where NVDB has none",
        "nvdb_version": "the version that was compared; null likewise",
        "skiltnummer_nvdb": "codes in NVDB, top down, joined by ;",
        "skiltnummer_seen": "codes as seen, likewise",
        "distance_m": _DISTANCE,
        "distance_sigma_m": "our one sigma along it",
        "drive_ids": "drives that saw it, or looked for it, joined by ,",
        "n_sightings": "how often it was seen",
        "decision": "open, accept, dismiss or defer: decide here, or with twin review",
        "cameras": "that saw it, joined by ,; of what was not seen, those of the drives that looked for it",
        "synced_at": f"{_SYNCED}; where NVDB has none, the newest fetch of the mirror",
        "software": "version of twin that matched",
        "config_sha256": "of everything that findings depend on but NVDB: settings, drives, estimates",
        "sign": "the sign by code and name: 142 – Barn",
        "road": "where it stands: vegsystemreferanse and street, where they are known",
        "comment": "why it was decided so: write here; empty where nobody has decided",
        "author": "who decided: likewise",
        "crop_face": "masked picture of its best view, a path beside the file; empty where there is none",
        "crop_wide": "masked picture of its surroundings, likewise",
    },
    "moves": {
        "change_id": _CHANGE_ID,
        "verdict": _VERDICT,
        "distance_m": _DISTANCE,
        "distance_sigma_m": "one sigma of that distance",
    },
    "nvdb_signs": {
        "nvdb_id": "NVDB's id of the object",
        "nvdb_type": "95 Skiltpunkt or 96 Skiltplate",
        "version": "its version in NVDB",
        "point_id": "of a plate: its Skiltpunkt",
        "skiltnummer": "of a plate: its sign code",
        "text": "of a plate: what is written on it",
        "own_geometry": "whether the position is its own; else it lies on the road's centre line",
        "accuracy_cm": "NVDB's nøyaktighet: one sigma in plan",
        "capture_method": "NVDB's datafangstmetode",
        "road_reference": "vegsystemreferanse, as people write it",
        "ansiktsside": "which traffic a plate's face looks at",
        "last_modified": "when it was last changed in NVDB",
        "synced_at": _SYNCED,
    },
    "estimates": {
        "estimate_id": "drive:object:method",
        "drive_id": "the drive",
        "object": _OBJECT,
        "label": "as annotated",
        "skiltnummer": "codes of its plates, top down, joined by ;",
        "nvdb_type": "vegobjekttype: 95 of a sign, else that of its label",
        "method": "adjusted, single-frame or paper",
        "n_sightings": "sightings that it rests on",
        "n_frames": "frames in which it was seen",
        "n_cameras": "cameras that saw it",
        "first_seen": "first sighting",
        "last_seen": "last sighting",
        "range_min_m": "from the car to the object at the nearest sighting",
        "height_m": "of its foot, ellipsoidal; null of paper, which gives none",
        "height_nn2000_m": "of its foot, NN2000; null where no geoid model is installed",
        "sigma_major_m": _MAJOR,
        "sigma_minor_m": _MINOR,
        "sigma_azimuth_deg": "direction of the long axis, from true north",
        "cep95_m": _CEP,
        "flags": "remarks, joined by ;",
        "sigma_height_m": "one sigma of its height; null where the method does not tell",
        "sigma_east_m": "one sigma of grid east, EPSG:25833",
        "sigma_north_m": "one sigma of grid north, likewise",
        "correlation": "of east and north, -1 to 1",
    },
    "ellipses": {
        "estimate_id": "drive:object:method",
        "object": _OBJECT,
        "sigma_major_m": _MAJOR,
        "sigma_minor_m": _MINOR,
        "cep95_m": _CEP,
    },
    "drives": {
        "drive_id": "the drive",
        "name": "as in drive.toml, else the folder's",
        "started": "first epoch",
        "ended": "last epoch",
        "n_frames": "frames of all cameras",
        "n_sightings": "sightings that count",
        "annotations_complete": "declared: every sign in view was annotated",
        "datum": "of its positions before they were brought to EUREF89",
        "length_m": "driven",
    },
}
"""Layer → column → what it says. Units stand with the columns (:data:`twin.export.layers.COLUMNS`)."""
