"""Real recordings as drives. Nothing of them is copied into the project: folders are made while tests run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from checkout import REAL

from geoloc.earth.geodesy import geographic_from_enu, geographic_from_utm33
from nvdb.objects import skilt_from_les_v4

BOLLARD = "c46bad07"
"""The object, seen 180 times, that is set down beside a recorded plate of Oslo."""
BESIDE_M = 0.5
"""How far east of the plate."""


@dataclass(frozen=True)
class OsloDrive:
    """A drive folder and the surveyed truth of its objects."""

    folder: Path
    truth: Path
    plate_id: int
    """The Oslo plate beside which the log is set down."""


def _real(name: str) -> Path:
    folder = REAL / name
    if not folder.exists():
        pytest.skip(f"the real data {name} are not beside the checkout")
    return folder


@pytest.fixture(scope="session")
def oslo_pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recorded Oslo pages alone, as the replay server takes them: a folder of links."""
    source = _real("nvdb/les_v4_live_2026-09/signs-0301-page1.json")
    folder = tmp_path_factory.mktemp("oslo")
    (folder / source.name).symlink_to(source)
    return folder


@pytest.fixture(scope="session")
def av2_drive(tmp_path_factory: pytest.TempPathFactory) -> OsloDrive:
    """The Argoverse log as a generic drive folder, set down in Oslo."""
    from real_drives import argoverse_drive

    source = _argoverse()
    plate_id, anchor = _anchor(source)
    made = argoverse_drive(tmp_path_factory.mktemp("argoverse") / "7fab2350", anchor, source)
    return OsloDrive(made.folder, made.truth, plate_id)


@pytest.fixture(
    scope="session",
    params=[
        pytest.param(0.0, id="exact pixels", marks=pytest.mark.slow),
        pytest.param(1.5, id="1.5 px of noise"),
    ],
)
def av2_near_trondheim(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """The Argoverse log, set down where nothing is, as published and as an annotator would mark it."""
    from real_drives import TRONDHEIM, argoverse_drive

    folder = tmp_path_factory.mktemp("argoverse") / "7fab2350"
    return [argoverse_drive(folder, TRONDHEIM, _argoverse(), noise_px=request.param)]


@pytest.fixture(scope="session")
def kitti_folders(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """The five KITTI sequences as generic drive folders."""
    from real_kitti import kitti_drives

    return kitti_drives(tmp_path_factory.mktemp("kitti"), _real("kitti_signs"))  # type: ignore[no-any-return]


def _argoverse() -> Path:
    pytest.importorskip("pyarrow", reason="reading the log's feather files needs pyarrow")
    return _real("av2")


def _anchor(source: Path) -> tuple[int, tuple[float, float]]:
    """Where the log's origin must lie in Oslo so that one bollard stands beside a recorded plate."""
    from real_drives import argoverse_feet

    page = json.loads((_real("nvdb/les_v4_live_2026-09/signs-0301-page1.json")).read_text(encoding="utf-8"))
    plate = skilt_from_les_v4(page["objekter"][0], 96)
    assert plate.own_geometry
    assert plate.position is not None
    lat, lon = geographic_from_utm33(plate.position.east_m, plate.position.north_m)
    seen = argoverse_feet(source)
    bollard = seen[seen.object == BOLLARD]
    east, north = float(bollard.east_m.median()) - BESIDE_M, float(bollard.north_m.median())
    place = geographic_from_enu(lat, lon, -east, -north)
    return plate.nvdb_id, (float(place[0]), float(place[1]))
