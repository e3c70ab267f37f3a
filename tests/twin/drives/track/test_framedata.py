"""Fixes from the JSON that DriveWorks' ingestion tools make of a GPS recording."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from track_writers import Recorded

from twin.drives.folder.drive_toml import read_settings
from twin.drives.folder.files import DriveFolder
from twin.drives.folder.notes import ReadingNotes
from twin.drives.rig.rig_files import rig_of_folder
from twin.drives.track.formats.framedata import read_gps
from twin.drives.track.read import read_track
from twin.errors import DriveError


def dump(recorded: Recorded, *, utc: bool) -> bytes:
    """Return one antenna's fixes as frames, among what is none."""
    fixes = recorded.fixes[0]
    records: list[dict[str, object]] = [{"timestamp_us": 5, "payload": {"latitude": None}}]
    for i, epoch_ns in enumerate(fixes.epoch_ns.tolist()):
        place = (float(fixes.latitude_deg[i]), float(fixes.longitude_deg[i]), float(fixes.height_m[i]))
        payload = dict(zip(("latitude", "longitude", "altitude"), place, strict=True))
        times = {"utcTimeUs": epoch_ns // 1000} if utc else {}
        records.append({"timestamp_us": int(fixes.host_ns[i]) // 1000, "payload": payload | times})
    return json.dumps({"metadata": {"fileType": "gps"}, "data": records}).encode()


@pytest.mark.parametrize("utc", [True, False])
def test_fixes_are_those_recorded(recorded: Recorded, utc: bool) -> None:
    """Places as written; the epoch is the UTC where the frames have it, else the host's, which is said."""
    fixes = recorded.fixes[0]
    read = read_gps(dump(recorded, utc=utc), "roof", "gps.json")
    assert np.array_equal(read.fixes.latitude_deg, fixes.latitude_deg)
    assert np.array_equal(read.fixes.height_m, fixes.height_m)
    wanted = fixes.epoch_ns if utc else fixes.host_ns // 1000 * 1000
    assert np.array_equal(read.fixes.epoch_ns, wanted)
    assert any("timed by the host" in warning for warning in read.warnings) is not utc
    assert [(s.reason, s.count) for s in read.skipped] == [("frame without a position", 1)]


def test_it_is_found_by_its_content(recorded: Recorded, tmp_path: Path) -> None:
    """Beside a rig file it is the recording of the antenna that drive.toml gives it."""
    (tmp_path / "rig.json").write_text((recorded.trip / "rig.json").read_text())
    (tmp_path / "gps_roof.json").write_bytes(dump(recorded, utc=True))
    settings = read_settings(b'[gnss]\nfiles = {"gnss50:vehicle" = "gps_roof.json"}\nsigma_m = 0.02\n')
    folder, notes = DriveFolder(tmp_path), ReadingNotes()
    rig, _ = rig_of_folder(folder, settings, notes)
    (fixes,) = read_track(folder, settings, rig, notes).gnss
    assert len(fixes.epoch_ns) == len(recorded.fixes[0].epoch_ns)


def test_what_is_no_json_is_said() -> None:
    """Amazon's ION is another format of the same tool."""
    with pytest.raises(DriveError, match="ION is not read"):
        read_gps(b"{timestamp_us: 5, payload: {}}", "roof", "gps.json")
