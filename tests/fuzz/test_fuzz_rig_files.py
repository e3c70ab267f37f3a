"""Rigs of drive folders, damaged: rig files, car masks as pictures, cameras in ``drive.toml``."""

from __future__ import annotations

import io
import json
import tempfile
from pathlib import Path

import numpy as np
from mutate import either, fuzzed, mutated, mutated_json, real_files
from PIL import Image

from geoloc.calibration_files.kalibr import kalibr_text
from geoloc.cameras import FisheyeCamera
from geoloc.rig.rig import FLU_R_RDF, Rig, RigCamera, rig_document, rig_from_document
from twin.drives.folder.drive_toml import DriveSettings, read_settings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import ReadingNotes
from twin.drives.rig.rig_files import rig_of_folder
from twin.errors import DriveError

MODEL = FisheyeCamera(64, 40, 30.0, 30.5, 31.0, 19.5, (0.01, -0.002, 0.0, 0.0))
MASK = np.zeros((40, 64), dtype=np.uint8)
MASK[:30] = 255
RIG = Rig({"front": RigCamera("front", MODEL, FLU_R_RDF, np.ones(3), None, None, MASK == 0)}, {}, "made up")
DOCUMENT = rig_document(RIG)
DOCUMENT["rig"]["sensors"][0]["sensor2Rig"] = {"quaternion": [0.5, -0.5, 0.5, -0.5], "t": [1.0, 0.0, 1.5]}
DOCUMENT["rig"]["sensors"][0]["correction_rig_T"] = [0.0, 0.0, 0.1]
DOCUMENT["rig"]["sensors"][0]["properties"] |= {
    "windshield-horizontal-polynomial": "0.001 1.01 0.0",
    "windshield-vertical-polynomial": [0.002, 0.0, 1.02],
    "windshield-polynomial-type": "backward",
}
CAMERA = b'[cameras.front]\nintrinsics = "chain.yaml#cam0"\nposition = [1.8, 0.1, 1.4]\n'
CAMERA += b'roll_pitch_yaw = [0.0, 2.5, 0.0]\nmask = "mask.png"\n'


def picture(kind: str) -> bytes:
    """The mask in a file format."""
    file = io.BytesIO()
    Image.fromarray(MASK).save(file, format=kind)
    return file.getvalue()


FILES = {"chain.yaml": kalibr_text([MODEL]).encode(), "mask.png": picture("PNG")}


def read(said: DriveSettings, **files: bytes) -> Rig | None:
    """Read the rig of a folder with these files; None where it is refused."""
    notes = ReadingNotes()
    with tempfile.TemporaryDirectory() as folder:
        for name, content in {**FILES, **files}.items():
            (Path(folder) / name).write_bytes(content)
        try:
            rig, text = rig_of_folder(DriveFolder(Path(folder)), said, notes)
        except DriveError:
            return None
    again = rig_from_document(json.loads(text), "kept")
    assert list(again.cameras) == list(rig.cameras)
    assert list(rig_from_document(rig_document(again), "written").cameras) == list(rig.cameras)
    return rig


@fuzzed(
    either(
        mutated([json.dumps(DOCUMENT).encode(), *real_files("naplab", ".json")]),
        mutated_json([DOCUMENT]),
    )
)
def test_rig_file_reader_raises_nothing_but_drive_errors(content: bytes) -> None:
    """A DriveError, or a rig that the kept text makes again."""
    read(DriveSettings(rig="rig.json"), **{"rig.json": content})


@fuzzed(mutated([picture("PNG"), picture("PPM"), picture("BMP"), picture("JPEG")]))
def test_mask_reader_raises_nothing_but_drive_errors(content: bytes) -> None:
    """A DriveError, or a mask of the camera's shape."""
    rig = read(read_settings(CAMERA), **{"mask.png": content})
    if rig is not None:
        mask = rig.cameras["front"].ego_mask
        assert mask is not None
        assert abs(mask.shape[1] * 40 / (mask.shape[0] * 64) - 1.0) <= 0.02


@fuzzed(mutated([CAMERA]))
def test_camera_settings_raise_nothing_but_drive_errors(content: bytes) -> None:
    """A DriveError, or a rig with the cameras that were described."""
    try:
        said = read_settings(content)
    except DriveError:
        return
    rig = read(said) if said.cameras else None
    assert rig is None or set(said.cameras) <= {*rig.cameras, *rig.unsupported}
