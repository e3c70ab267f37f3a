"""NN2000 in change sets, by Kartverket's own geoid model, and without it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from checkout import REAL, ROOT

GRIDS = REAL / "proj_grids"

CODE = """
import json, sys
sys.path.insert(0, sys.argv[1])
from findings import finding as a_finding
from nvdb.datakatalog import snapshot
from nvdb.endringssett import NewPlate, Punkt, endringssett, new_sign, to_xml, validate
from twin.changesets.drive_side import Seen, height_of, measured_position

place = {"east_m": 269979.6, "north_m": 7040000.0}
estimate = {"estimate_id": "d:P1:adjusted", **place, "height_m": 80.0, "sigma_height_m": 0.06}
drive = {"drive_id": "d", "started_ns": 1_780_000_000_000_000_000}
seen = Seen((drive,), (estimate,), {})
finding = a_finding(**place, covariance_m2=(0.0009, 0.0, 0.0016))
measured = measured_position(finding, seen)
where = Punkt(veglenkesekvens_id=1, posisjon=0.5, retning="MED", sideposisjon="H")
plates = [NewPlate(skiltnummer="202")]
sign = new_sign("n", measured, on_date=seen.first_day, stedfesting=where, plates=plates)
(sett,) = endringssett([sign], datakatalogversjon=snapshot().version)
(geometri,) = (e.geometri for e in sett.endringer[0].egenskaper if e.geometri is not None)
print(json.dumps({
    "wkt": geometri.wkt,
    "nøyaktighet": geometri.kvalitet.noyaktighet_cm,
    "nøyaktighetHøyde": geometri.kvalitet.noyaktighet_hoyde_cm,
    "errors": [str(found) for found in validate(sett) if found.severity == "feil"],
    "how": height_of(seen).how,
    "xml": to_xml(sett).decode(),
}))
"""


def _said(**environment: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(ROOT / "tests")],
        env={**os.environ, "PROJ_NETWORK": "OFF", **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def test_change_set_has_the_official_height() -> None:
    """Trondheim: 80 m above the ellipsoid are 39.4 m lower in NN2000, 6 cm and the model's 2 cm make 7."""
    if not GRIDS.exists():
        pytest.skip("the real data proj_grids are not beside the checkout")
    said = _said(PROJ_USER_WRITABLE_DIRECTORY=str(GRIDS))
    kind, (_, _, height) = said["wkt"].split("(")[0], said["wkt"].split("(")[1].rstrip(")").split()
    assert kind.strip() == "POINT Z"
    assert float(height) == pytest.approx(80.0 - 39.4, abs=0.3)
    assert (said["nøyaktighet"], said["nøyaktighetHøyde"], said["errors"]) == (5, 7, [])
    assert said["how"] == "NN2000 by the geoid model HREF2018B."


def test_change_set_without_the_geoid_model_has_no_height(tmp_path: Path) -> None:
    """No Z, no quality of a height, never the ellipsoidal one; and it is said why."""
    said = _said(PROJ_USER_WRITABLE_DIRECTORY=str(tmp_path))
    assert said["wkt"] == "POINT (269979.600 7040000.000)"
    assert (said["nøyaktighetHøyde"], said["errors"]) == (None, [])
    assert "Høyde" not in said["xml"]
    assert "HREF2018B is not installed" in said["how"]
