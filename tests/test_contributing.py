"""CONTRIBUTING.md: its map names what is there."""

from __future__ import annotations

import re
import tomllib

from checkout import ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_every_path_of_the_map_exists() -> None:
    """A file or folder that the map names is there."""
    paths = re.findall(r"`((?:geoloc|nvdb|twin|tests)/[\w/.]*)`", TEXT)
    assert len(paths) > 40
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_every_room_is_on_the_map() -> None:
    """A room of a layer contract stands on the map, and so does every folder of a package."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    for contract in contracts:
        for package in contract.get("containers", []):
            rooms = re.findall(r"\w+", " ".join(contract["layers"]))
            folders = [path.name for path in (ROOT / package).iterdir() if (path / "__init__.py").exists()]
            assert set(folders) <= set(rooms)
            missing = [
                room for room in rooms if f"`{package}/{room}/`" not in TEXT and f"`{room}.py`" not in TEXT
            ]
            assert missing == []
