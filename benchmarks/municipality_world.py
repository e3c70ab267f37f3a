"""A simulated municipality: its signs, what NVDB says of them, and a fleet that drives past."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from geoloc.arrays import FloatArray, IntArray
from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg
from geoloc.simulation.car import simulated_rig
from geoloc.trajectory.poses import Poses
from twin.matching.absence import Passage
from twin.matching.config import MatchConfig
from twin.matching.in_view import Places, PlaceViews, views_of_places
from twin.matching.plates.readings import family
from twin.matching.poles.poles import ObservedPole
from twin.matching.sites import Plate, Site
from twin.store.records import Estimate

ORIGIN = np.array([270_000.0, 7_040_000.0])
BLOCK_M = 500.0
BLOCKS = 10
DRIVE_M = 16_000.0
STEP_M = 2.0
NVDB_SIGMA_M = 0.3
EDITED = 0.02
TAKEN_DOWN = 0.005
CLUSTERED = 0.1
CODES = (  # noqa: SIM905
    "362.30 362.40 362.50 362.60 362.70 362.80 202 204 206 208 210 212 302 306.1 308 310 312 314 "
    "366.30 370 372 376.1 402 404.1 404.2 406 502 512 516 518 522 526 540 552 723 727 733 802 804 806 808 "
    "810 904H 904V 906H 906V 930.1 940"
).split()
"""Of many families, drawn with a weight of one over the rank."""
DAY_NS = 86_400_000_000_000
START_NS = 1_780_000_000_000_000_000


@dataclass(frozen=True, slots=True)
class World:
    """What stands where, and what NVDB says. Poles unknown to NVDB and sites without a pole are rows too.

    Attributes
    ----------
    place, recorded : float64 (n, 2)
        Where the pole stands and where NVDB has it, EPSG:25833.
    travel_deg : float64 (n,)
        Direction from true north of the traffic that it is for.
    stands, known : bool (n,)
        On the road; in NVDB.
    codes, nvdb_codes : tuples of str
        Of a plate that is exchanged between two drives, NVDB has what it was before.
    edit : (n,) "", "moved", "wrong_type", "new", "missing", or between two drives "taken_down", "exchanged"
    """

    place: FloatArray
    recorded: FloatArray
    travel_deg: FloatArray
    stands: NDArray[np.bool_]
    known: NDArray[np.bool_]
    codes: list[tuple[str, ...]]
    nvdb_codes: list[tuple[str, ...]]
    edit: NDArray[np.str_]

    @property
    def off_m(self) -> FloatArray:
        """How far NVDB's position is off."""
        return np.asarray(np.hypot(*(self.place - self.recorded).T))


def make_world(n_signs: int, rng: np.random.Generator, exchanged: float = 0.0) -> World:
    """Draw the municipality; `exchanged` is the share of poles of which a plate is exchanged meanwhile."""
    place, azimuth_grid = _places(n_signs, rng)
    n = len(place)
    weight = 1.0 / np.arange(1, len(CODES) + 1)
    weight /= weight.sum()
    n_plates = rng.choice([1, 2, 3, 4, 5], n, p=[0.55, 0.25, 0.1, 0.05, 0.05])
    codes = [tuple(rng.choice(CODES, k, replace=False, p=weight).tolist()) for k in n_plates]
    edit = np.full(n, "", dtype="U10")
    order = rng.permutation(n)
    each = round(EDITED * n)
    for k, name in enumerate(("moved", "wrong_type", "new", "missing")):
        edit[order[k * each : (k + 1) * each]] = name
    gone = 4 * each + round(TAKEN_DOWN * n)
    edit[order[4 * each : gone]] = "taken_down"
    edit[order[gone : gone + round(exchanged * n)]] = "exchanged"
    recorded = place + rng.normal(0, NVDB_SIGMA_M, (n, 2))
    turn = rng.uniform(0, 2 * np.pi, n)
    shift = rng.uniform(0.5, 10.0, n)[:, np.newaxis] * np.stack([np.sin(turn), np.cos(turn)], axis=1)
    recorded = np.where((edit == "moved")[:, np.newaxis], recorded + shift, recorded)
    nvdb_codes = [
        _with_wrong_code(c, rng) if e in {"wrong_type", "exchanged"} else c
        for c, e in zip(codes, edit, strict=True)
    ]
    convergence = grid_convergence_deg(*geographic_from_utm33(*place.T))
    return World(
        place=place,
        recorded=recorded,
        travel_deg=(azimuth_grid + convergence) % 360.0,
        stands=edit != "missing",
        known=edit != "new",
        codes=codes,
        nvdb_codes=nvdb_codes,
        edit=edit,
    )


def _places(n_signs: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Poles on the right of the traffic they are for: 3 m apart or more, or 0.8 m apart in clusters."""
    found: list[tuple[float, float, float]] = []
    taken: set[tuple[int, int]] = set()
    while len(found) < n_signs:
        heading = int(rng.integers(4))
        along, road = rng.uniform(0, BLOCKS * BLOCK_M), rng.integers(BLOCKS + 1) * BLOCK_M
        direction = np.array([(0, 1), (1, 0), (0, -1), (-1, 0)][heading], dtype=float)
        right = np.array([direction[1], -direction[0]])
        centre = ORIGIN + (np.array([road, along]) if heading % 2 == 0 else np.array([along, road]))
        foot = centre + right * rng.uniform(3.5, 6.0)
        cell = (int(foot[0] // 3), int(foot[1] // 3))
        if taken & {(cell[0] + a, cell[1] + b) for a in (-1, 0, 1) for b in (-1, 0, 1)}:
            continue
        taken.add(cell)
        size = int(rng.integers(2, 5)) if rng.random() < CLUSTERED / 3 else 1
        found += [(*(foot + 0.8 * k * right), 90.0 * heading) for k in range(size)]
    rows = np.array(found[:n_signs])
    return rows[:, :2], rows[:, 2]


def _with_wrong_code(codes: tuple[str, ...], rng: np.random.Generator) -> tuple[str, ...]:
    which = int(rng.integers(len(codes)))
    others = [code for code in CODES if code not in codes]
    return tuple(str(rng.choice(others)) if k == which else code for k, code in enumerate(codes))


def sites_of(world: World) -> tuple[list[Site], IntArray]:
    """What NVDB has, and the row of the world that each site is of."""
    rows = np.flatnonzero(world.known)
    sites = []
    for k in rows.tolist():
        face = ((world.travel_deg[k] + 180.0) % 360.0, math.nan)
        plates = tuple(
            Plate(100_000 + 10 * k + i, 1, code, "Trafikk i metreringsretning", face)
            for i, code in enumerate(world.nvdb_codes[k])
        )
        east, north = world.recorded[k].tolist()
        sites.append(Site(95, k + 1, 1, east, north, NVDB_SIGMA_M, True, plates, "2010-01-01"))
    return sites, rows


def on_the_centre_line(sites: Sequence[Site], share: float, rng: np.random.Generator) -> list[Site]:
    """Let NVDB have some of the sites only on their road's centre line, as a store with the network has them.

    Roads are metered to the north and to the east.
    """
    found = list(sites)
    for k in np.flatnonzero(rng.random(len(sites)) < share).tolist():
        place = np.array([sites[k].east_m, sites[k].north_m])
        centre = ORIGIN + np.round((place - ORIGIN) / BLOCK_M) * BLOCK_M
        axis = int(np.argmin(np.abs(place - centre)))  # 0: the road runs to the north
        right = (place - centre)[axis] * (1 if axis == 0 else -1) > 0
        foot = place.copy()
        foot[axis] = centre[axis]
        found[k] = replace(
            sites[k],
            east_m=float(foot[0]),
            north_m=float(foot[1]),
            sigma_m=MatchConfig().centre_line_sigma_m,
            own_geometry=False,
            road_azimuth_deg=0.0 if axis == 0 else 90.0,
            side="H" if right else "V",
        )
    return found


def wandering(rng: np.random.Generator) -> Poses:
    """Poses every 2 m of a drive that turns at random at crossings, 1.75 m right of the centre line."""
    node = rng.integers(0, BLOCKS + 1, 2)
    heading = int(rng.integers(4))
    places, headings = [], []
    steps = np.array([(0, 1), (1, 0), (0, -1), (-1, 0)])
    for _ in range(round(DRIVE_M / BLOCK_M)):
        turns = (heading, (heading + 1) % 4, (heading + 3) % 4, (heading + 2) % 4)
        ways = [h for h in turns if ((node + steps[h] >= 0) & (node + steps[h] <= BLOCKS)).all()]
        # Back only from a dead end.
        heading = int(rng.choice(ways[:-1] if len(ways) > 1 else ways))
        direction = steps[heading].astype(float)
        right = np.array([direction[1], -direction[0]])
        along = np.arange(0.0, BLOCK_M, STEP_M)[:, np.newaxis]
        places.append(ORIGIN + node * BLOCK_M + direction * along + 1.75 * right)
        headings.append(np.full(len(along), 90.0 * heading))
        node = node + steps[heading]
    place, azimuth = np.concatenate(places), np.concatenate(headings)
    lat, lon = geographic_from_utm33(*place.T)
    n = len(place)
    nil = np.zeros(n)
    return Poses(
        epoch_ns=np.zeros(n, dtype=np.int64),
        latitude_deg=lat,
        longitude_deg=lon,
        height_m=nil,
        roll_deg=nil,
        pitch_deg=nil,
        heading_deg=(azimuth + grid_convergence_deg(lat, lon)) % 360.0,
        speed_mps=nil + 13.0,
        sigma_horizontal_m=nil,
        sigma_vertical_m=nil,
        sigma_roll_deg=nil,
        sigma_pitch_deg=nil,
        sigma_heading_deg=nil,
        valid=np.ones(n, dtype=bool),
        reason=np.full(n, ""),
    )


@dataclass(frozen=True, slots=True)
class Fleet:
    """What the drives brought home.

    Attributes
    ----------
    estimates : rows of the ``estimate`` table; ``object`` is the row of the world
    seen_from_deg : member → directions
    passages : of the sites
    order : ids of the drives in time order
    tracks : where they drove
    """

    estimates: list[Estimate]
    seen_from_deg: dict[str, frozenset[float]]
    passages: list[Passage]
    order: list[str]
    tracks: list[Poses]


def drive_around(
    world: World,
    sites: Sequence[Site],
    n_drives: int,
    overlooked: float,
    rng: np.random.Generator,
    misread: float = 0.0,
) -> Fleet:
    """Let the drives see what they pass; some signs are taken down, or exchanged, between two of them."""
    config, rig = MatchConfig(), simulated_rig()
    pole_east, pole_north = world.place.T
    east, north = np.array([(s.east_m, s.north_m) for s in sites]).T
    # Only to know which face each pole of the world has.
    fronts = [
        Site(95, 0, 1, x, y, 0.0, True, (Plate(0, 1, "", None, (f, math.nan)),))
        for (x, y), f in zip(world.place.tolist(), ((world.travel_deg + 180.0) % 360.0).tolist(), strict=True)
    ]
    taken_down = rng.integers(1, n_drives, len(world.place))
    taken_down[world.edit != "taken_down"] = n_drives
    known_gone = np.zeros(len(world.place), dtype=bool)
    exchanged = np.flatnonzero(world.edit == "exchanged")
    exchanged_at = dict(
        zip(exchanged.tolist(), rng.integers(1, n_drives, exchanged.size).tolist(), strict=True)
    )
    seen_since: set[int] = set()
    visible = world.stands & (rng.random(len(world.place)) >= config.p_hidden)
    fleet = Fleet([], {}, [], [], [])
    for number in range(n_drives):
        name, poses = f"D{number:02}", wandering(rng)
        started = START_NS + number * 9 * DAY_NS
        views = views_of_places(rig, poses, pole_east, pole_north, config, cameras=list(rig.cameras))
        of_front = Places.of_sites(fronts).are_fronts(views)
        views = PlaceViews(views.place[of_front], views.azimuth_deg[of_front])
        count = np.bincount(views.place, minlength=len(world.place))
        passed = count >= config.min_views
        known_gone |= (number >= taken_down) & passed
        annotated = visible & (number < taken_down) & passed & (rng.random(count.size) >= overlooked)
        rows = np.flatnonzero(annotated)
        now = {
            k: world.codes[k] if number >= exchanged_at.get(k, 0) else world.nvdb_codes[k]
            for k in rows.tolist()
        }
        seen_since |= {k for k in exchanged_at.keys() & now.keys() if number >= exchanged_at[k]}
        if misread:
            now = {k: _misread(codes, misread, rng) for k, codes in now.items()}
        fleet.estimates.extend(_estimates(name, started, world, now, count, rng))
        fleet.seen_from_deg.update(_directions(name, views, annotated))
        seen = views_of_places(rig, poses, east, north, config, cameras=list(rig.cameras))
        fleet.tracks.append(poses)
        fleet.passages.append(Passage(name, started, True, Places.of_sites(sites).count(seen)))
        fleet.order.append(name)
    # What was taken down or exchanged after the last drive that passed it, nobody can know of.
    world.stands[known_gone] = False
    world.edit[(world.edit == "taken_down") & ~known_gone] = ""
    for k in exchanged_at.keys() - seen_since:
        world.edit[k], world.codes[k] = "", world.nvdb_codes[k]
    return fleet


def _misread(codes: tuple[str, ...], share: float, rng: np.random.Generator) -> tuple[str, ...]:
    """Each plate may be given another code: half of the slips within its family, where that has others."""
    read = list(codes)
    for k in np.flatnonzero(rng.random(len(codes)) < share).tolist():
        kin = [code for code in CODES if family(code) == family(codes[k]) and code != codes[k]]
        others = kin if kin and rng.random() < 0.5 else [code for code in CODES if code != codes[k]]
        read[k] = str(rng.choice(others))
    return tuple(read)


def past_poles(fleet: Fleet, poles: Sequence[ObservedPole]) -> list[Passage]:
    """What the drives had in view of the observed poles."""
    rig, places, config = simulated_rig(), Places.of_poles(poles), MatchConfig()
    east, north = places.place_m.T
    seen = [views_of_places(rig, one, east, north, config, cameras=list(rig.cameras)) for one in fleet.tracks]
    return [
        replace(passage, counts=places.count(views))
        for passage, views in zip(fleet.passages, seen, strict=True)
    ]


def _directions(name: str, views: PlaceViews, annotated: NDArray[np.bool_]) -> dict[str, frozenset[float]]:
    found: dict[int, set[float]] = {}
    steps = np.round(views.azimuth_deg / 30.0) * 30.0 % 360.0
    for k, degrees in set(zip(views.place.tolist(), steps.tolist(), strict=True)):
        if annotated[k]:
            found.setdefault(k, set()).add(degrees)
    return {f"{name}:{k}": frozenset(directions) for k, directions in found.items()}


def _estimates(
    name: str,
    started_ns: int,
    world: World,
    codes: Mapping[int, tuple[str, ...]],
    count: IntArray,
    rng: np.random.Generator,
) -> list[Estimate]:
    """Draw positions from their covariances; half of each variance is the drive's own."""
    common = rng.normal(size=2)
    found = []
    for k in codes:
        along, across = rng.uniform(0.08, 0.15), rng.uniform(0.05, 0.08)
        turn = math.radians(world.travel_deg[k])
        axes = np.array([[math.sin(turn), math.cos(turn)], [math.cos(turn), -math.sin(turn)]]).T
        error = axes @ (np.array([along, across]) * (common + rng.normal(size=2)) * math.sqrt(0.5))
        covariance = axes @ np.diag([along**2, across**2]) @ axes.T
        found.append(
            Estimate(
                drive_id=name,
                object=str(k),
                east_m=float(world.place[k, 0] + error[0]),
                north_m=float(world.place[k, 1] + error[1]),
                covariance_m2=(float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])),
                codes=tuple(codes[k]),
                cameras=("C1_front60Single",),
                n_sightings=int(count[k]),
                first_ns=started_ns,
                last_ns=started_ns,
            )
        )
    return found
