"""The road network against recorded answers: lengths, links that meet, and places that NVDB worked out."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from checkout import REAL
from defusedxml import ElementTree

from nvdb.objects import point_from_wkt
from nvdb.vegnett import Veglenke, Vegnett, Vegreferanse, stedfester
from nvdb.vegnett.stedfest import meter_kortform, position_text

NVDB = REAL / "nvdb"
DAY = date(2026, 5, 4)
CHANGESET = {"v3": "http://nvdb.vegvesen.no/apiskriv/domain/changeset/v3"}


def _real(name: str) -> Path:
    path = NVDB / name
    if not path.exists():
        pytest.skip(f"the recorded answers nvdb/{name} are not beside the checkout")
    return path


def _json(name: str) -> Any:
    return json.loads(_real(name).read_text(encoding="utf-8"))


def _veglenkesekvenser() -> Iterator[dict[str, Any]]:
    for path in sorted(_real("uberiket_tnits").glob("veglenkesekvens*.json")):
        if "fiktiv" not in path.name:
            page = json.loads(path.read_text(encoding="utf-8"))
            yield from page.get("veglenkesekvenser", [page])


@pytest.fixture(scope="module")
def nett() -> Vegnett:
    """All recorded veglenkesekvenser of Uberiket, each once."""
    return Vegnett.from_uberiket({raw["id"]: raw for raw in _veglenkesekvenser()}.values())


def test_recorded_veglenkesekvenser_are_all_readable(nett: Vegnett) -> None:
    """Not one of some 270 recorded links is rejected, and the ended ones are kept and known as such."""
    assert nett.rejected == ()
    assert len(nett) > 250
    assert 10 < np.count_nonzero(~nett.valid(DAY)) < 30


def test_recorded_length_of_geometry_is_its_length_with_heights() -> None:
    """NVDB's stated geometri.lengde is the 3-D length to 1 mm; in plan the links are up to 1.8 m shorter."""
    links = [
        link["geometri"] for raw in _veglenkesekvenser() for link in raw["veglenker"] if "geometri" in link
    ]
    coordinates = [shapely.get_coordinates(shapely.from_wkt(link["wkt"]), include_z=True) for link in links]
    stated = np.array([link["lengde"] for link in links])
    with_heights = np.array([np.linalg.norm(np.diff(xyz, axis=0), axis=1).sum() for xyz in coordinates])
    in_plan = np.array([np.linalg.norm(np.diff(xyz[:, :2], axis=0), axis=1).sum() for xyz in coordinates])
    assert np.abs(stated - with_heights).max() < 1e-3
    assert np.abs(stated - in_plan).max() > 1.0


def test_recorded_links_meet_where_their_positions_meet(nett: Vegnett) -> None:
    """Where one valid link ends and the next begins in position, they do so in place: within 1 cm."""
    rows = np.flatnonzero(nett.valid(DAY))
    here, following = rows[:-1], rows[1:]
    joined = (nett.veglenkesekvensid[here] == nett.veglenkesekvensid[following]) & (
        nett.sluttposisjon[here] == nett.startposisjon[following]
    )
    ends = shapely.get_point(nett.geometri[here[joined]], -1)
    begins = shapely.get_point(nett.geometri[following[joined]], 0)
    assert np.count_nonzero(joined) > 100
    assert shapely.distance(ends, begins).max() < 0.01


def test_stedfest_finds_known_places_on_recorded_roads(nett: Vegnett) -> None:
    """Points set at known 3-D lengths along real links, moved 1 cm aside, are found where they were set.

    The tolerance is 1 mm along the link and what a bend does to 1 cm.
    """
    rng = np.random.default_rng(20260504)
    rows = np.flatnonzero(nett.valid(DAY) & ~nett.konnektering & ~nett.detaljert)
    rows = np.repeat(rows, 20)
    fraction = rng.uniform(0.02, 0.98, len(rows))
    places = [_along(nett.geometri[row], part) for row, part in zip(rows, fraction, strict=True)]
    at, direction = (np.array(column) for column in zip(*places, strict=True))
    aside = rng.choice([-0.01, 0.01], len(rows))
    right = np.column_stack([direction[:, 1], -direction[:, 0]])
    points = at + aside[:, np.newaxis] * right
    place = stedfester(nett, on_date=DAY).stedfest(points[:, 0], points[:, 1])
    assert place.found.all()
    # Some recorded links lie on top of each other at intersections: those points may be on the neighbour.
    same = place.veglenke == rows
    assert np.count_nonzero(same) > 0.99 * len(rows)
    span = nett.sluttposisjon[rows] - nett.startposisjon[rows]
    length = np.array([_length(nett.geometri[row]) for row in rows])
    expected = nett.startposisjon[rows] + fraction * span
    error_m = np.abs(place.relativ_posisjon - expected) / span * length
    assert np.median(error_m[same]) < 1e-3
    assert error_m[same].max() < 0.02
    assert (np.sign(place.right_m) == np.sign(aside))[same].all()


def _length(line: Any) -> float:
    xyz = shapely.get_coordinates(line, include_z=True)
    return float(np.linalg.norm(np.diff(xyz, axis=0), axis=1).sum())


def _along(line: Any, fraction: float) -> tuple[np.ndarray, np.ndarray]:
    """Plan position and direction at a part of the 3-D length."""
    xyz = shapely.get_coordinates(line, include_z=True)
    steps = np.diff(xyz, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    i = min(int(np.searchsorted(along, fraction * along[-1], side="right")) - 1, len(steps) - 1)
    t = (fraction * along[-1] - along[i]) / lengths[i]
    plan = steps[i, :2]
    return xyz[i, :2] + t * plan, plan / np.hypot(*plan)


def test_stedfest_of_the_documented_anchor_lands_on_nvdbs_network_point() -> None:
    """API Skriv's example, a Skiltpunkt 4.96 m from its place on the road, is found where NVDB found it.

    NVDB projected the request's anchor (``forankring``), not the sign. The example gives no geometry: a road
    through the network point at a right angle to the anchor is the only one on which that point is nearest.
    """
    request = ElementTree.parse(_real("skriv_v3_examples/stedfest_request_skiltpunkt_95.xml"))
    answer = ElementTree.parse(_real("skriv_v3_examples/stedfest_response_ok.xml"))
    sign, anchor = _point(request, "wkt"), _point(request, "startWkt")
    foot = _point(answer, "wkt")
    place = answer.find(".//v3:punkt", CHANGESET)
    assert place is not None
    across = (anchor - foot) / np.hypot(*(anchor - foot))
    road = np.array([-across[1], across[0]])  # a quarter turn to the left: the anchor is on its right
    sekvens, position = int(place.attrib["veglenkesekvensNvdbId"]), float(place.attrib["posisjon"])
    link = Veglenke(
        veglenkesekvensid=sekvens,
        veglenkenummer=1,
        segmentnummer=1,
        startposisjon=position - 0.1,
        sluttposisjon=position + 0.1,
        geometri=shapely.LineString([foot - 80 * road, foot + 80 * road]),
        startdato=date(2000, 1, 1),
        referanse=Vegreferanse("FV6690 S1D1 m0-160", "F", "V", 6690, "K", "MED", 0.0, 160.0),
    )
    found = stedfester(Vegnett.from_veglenker([link]), on_date=date(2020, 1, 1)).stedfest(
        *anchor[:, np.newaxis]
    )
    assert found.distance_m == pytest.approx([np.hypot(2.9663, 0.9893)], abs=1e-4)
    assert np.hypot(found.east[0] - foot[0], found.north[0] - foot[1]) < 1e-6
    assert found.veglenkeposisjoner() == [f"{position_text(position)}@{sekvens}"]
    assert found.sideposisjon.tolist() == ["H"]
    assert np.hypot(*(sign - [found.east[0], found.north[0]])) == pytest.approx(4.96, abs=0.005)


def _point(document: Any, tag: str) -> np.ndarray:
    element = document.find(f".//v3:{tag}", CHANGESET)
    assert element is not None
    return np.array(point_from_wkt(str(element.text))[:2])


def test_recorded_short_forms_are_written_as_nvdb_writes_them() -> None:
    """Positions and metres of recorded answers come out of our writers letter by letter."""
    answer = _json("lesv3/posisjon/posisjon.json")
    strekning = answer["vegsystemreferanse"]["strekning"]
    assert (
        meter_kortform("FV4854 S2D20 m0-1000", strekning["meter"]) == answer["vegsystemreferanse"]["kortform"]
    )
    sekvens = answer["veglenkesekvens"]
    assert (
        f"{position_text(sekvens['relativPosisjon'])}@{sekvens['veglenkesekvensid']}" == sekvens["kortform"]
    )
    for place in _json("lesv3/vegobjekter/lokasjon_punkt.json")["stedfestinger"]:
        assert f"{position_text(place['relativPosisjon'])}@{place['veglenkesekvensid']}" == place["kortform"]
    for stretch in _json("lesv3/vegobjekter/lokasjon_linje.json")["stedfestinger"]:
        ends = f"{position_text(stretch['startposisjon'])}-{position_text(stretch['sluttposisjon'])}"
        assert f"{ends}@{stretch['veglenkesekvensid']}" == stretch["kortform"]
