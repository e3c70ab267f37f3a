"""Drives whose clock was stated wrongly, and NVDB's signs that show it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sqlalchemy as sa

from geoloc.earth.geodesy import utm33_from_geographic
from twin.matching.config import MatchConfig
from twin.matching.match_store import match
from twin.matching.poles.ahead import Ahead, Signs, ahead_of_nvdb
from twin.matching.sites import Site, mirror_near, sites_from_mirror
from twin.store import schema
from twin.store.poses import poses_from_blob
from twin.store.records import Estimate
from twin.store.store import Store

ADJUSTED = schema.estimate.c.method == "adjusted"
NVDB_SIGMA_M = 0.3


def late(opened: Store, seconds: float, sigma_m: float) -> list[Estimate]:
    """The sample's signs as a camera places them whose clock is late: seen from further along the path."""
    (row,) = opened.rows(sa.select(schema.drive.c.poses))
    poses = poses_from_blob(row["poses"])
    east, north = utm33_from_geographic(poses.latitude_deg, poses.longitude_deg)
    at_s = 1e-9 * (poses.epoch_ns - poses.epoch_ns[0])
    path = east + 1j * north

    def car(then: float) -> tuple[complex, complex]:
        """Where it is on the grid, and the way that it goes there."""
        ahead, here = (complex(np.interp(t, at_s, path)) for t in (then + 0.3, then))
        return here, (ahead - here) / abs(ahead - here)

    signs = []
    for one in map(Estimate.from_row, opened.rows(sa.select(schema.estimate).where(ADJUSTED))):
        seen_s = 1e-9 * (one.last_ns - poses.epoch_ns[0]) - 0.5
        if at_s[0] <= seen_s + seconds <= at_s[-1] - 0.3:
            (here, way), (there, other_way) = car(seen_s), car(seen_s + seconds)
            place = there + (one.east_m + 1j * one.north_m - here) / way * other_way
            square = (sigma_m**2, 0.0, sigma_m**2)
            signs.append(replace(one, east_m=place.real, north_m=place.imag, covariance_m2=square))
    return signs


def found(opened: Store, signs: list[Estimate], sites: list[Site] | None = None) -> Ahead | None:
    """What is found of the sample's drive with these signs, against these sites or the mirror's."""
    (row,) = opened.rows(sa.select(schema.drive.c.poses))
    if sites is None:
        with opened.snapshot() as view:
            places = np.array([(one.east_m, one.north_m) for one in signs])
            config = MatchConfig()
            sites = sites_from_mirror(*mirror_near(view, places, config), config)
    return ahead_of_nvdb(Signs.of(signs, poses_from_blob(row["poses"])), sites)


@pytest.mark.parametrize(("seconds", "sigma_m"), [(2.0, 11.0), (5.0, 14.0), (-3.0, 11.0), (1.0, 0.1)])
def test_one_shift_of_all_signs_is_found(opened: Store, seconds: float, sigma_m: float) -> None:
    """Whether the sign is ahead or behind, and however well the drive says that it is known."""
    ahead = found(opened, late(opened, seconds, sigma_m))
    assert ahead is not None
    assert ahead.late_s == pytest.approx(seconds, abs=0.3)
    assert ahead.along_m == pytest.approx(11.1 * seconds, rel=0.2)


def test_what_the_drive_says_of_itself_is_no_shift(opened: Store) -> None:
    """A right drive has none; nor has one within its own sigma, nor one of which three signs are known."""
    assert found(opened, late(opened, 0.0, 0.1)) is None
    assert found(opened, late(opened, 0.5, 11.0)) is None
    assert found(opened, late(opened, 2.0, 11.0)[:3]) is None


@pytest.mark.parametrize("seed", range(5))
def test_some_that_moved_or_alike_are_no_shift(opened: Store, seed: int) -> None:
    """Markers of one code 25 m apart, a third of them moved, new or gone by chance: the drive is right."""
    rng = np.random.default_rng(seed)
    (sign, *_) = late(opened, 0.0, 0.1)
    with opened.snapshot() as view:
        config = MatchConfig()
        places = np.array([(sign.east_m, sign.north_m)])
        (site, *_) = (
            s for s in sites_from_mirror(*mirror_near(view, places, config), config) if s.own_geometry
        )
    signs, sites = [], []
    (row,) = opened.rows(sa.select(schema.drive.c.poses))
    poses = poses_from_blob(row["poses"])
    path = np.stack(utm33_from_geographic(poses.latitude_deg, poses.longitude_deg), axis=1)
    for k in range(0, len(path), 65):
        east, north = path[k]
        there = replace(
            sign, east_m=east, north_m=north, first_ns=int(poses.epoch_ns[k]), last_ns=int(poses.epoch_ns[k])
        )
        known = replace(site, east_m=east + rng.normal(0, NVDB_SIGMA_M), north_m=north)
        fate = rng.random()
        if fate < 0.15:
            known = replace(known, north_m=north + rng.uniform(2, 10))
        if not 0.15 <= fate < 0.3:
            sites.append(
                replace(known, plates=tuple(replace(p, code=sign.codes[0]) for p in known.plates[:1]))
            )
        signs.append(there)
    assert len(signs) > 15
    assert found(opened, signs, sites) is None


def test_match_puts_every_finding_of_a_shifted_drive_up_for_review(opened: Store) -> None:
    """Two seconds late, stated to one: nothing is moved, new or missing, and the reason says why."""
    signs = late(opened, 2.0, 11.0)
    with opened.transaction() as connection:
        for one in signs:
            place = {"east_m": one.east_m, "north_m": one.north_m}
            place |= {"cov_ee_m2": 121.0, "cov_en_m2": 0.0, "cov_nn_m2": 121.0}
            this = ADJUSTED & (schema.estimate.c.object == one.object)
            connection.execute(sa.update(schema.estimate).where(this).values(**place))
        opened.touch(connection)
    report = match(opened)
    claims = [report.verdicts[verdict] for verdict in ("moved", "wrong_type", "new", "missing")]
    assert claims == [0, 0, 0, 0]
    assert report.verdicts["review"] >= 10
    assert report.warnings[0].startswith(
        "All signs of the drive trip_trondheim lie about 22 m ahead of NVDB's, as if"
    )
