"""Tracking: sightings are followed through the pictures, those that can never meet side by side."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from geoloc.arrays import IntArray
from geoloc.association.bearings import AssociationRules, Bearings, bearings_from_sightings
from geoloc.association.inverse_depth import first_points, innovations, update
from geoloc.association.tracking import costs, may_join, numbered, one_to_one, track
from geoloc.locate.observations import Observations
from geoloc.locate.records import Kind, Sightings
from geoloc.simulation.simulate import scenario, simulate_drive
from geoloc.trajectory.trajectory import trajectory_from_gnss

RULES = AssociationRules()


@cache
def bearings(minutes: float) -> Bearings:
    """Bearings of a drive on a long road, a third of them called faces."""
    drive = simulate_drive(scenario("highway", None, 3, minutes), 3)
    seen = drive.sightings
    arms = {name: antenna.rig_t_antenna_m for name, antenna in drive.rig.antennas.items()}
    trajectory = trajectory_from_gnss(drive.gnss, arms)
    stamps = [drive.frame_host_ns[c][f] for c, f in zip(seen.camera.tolist(), seen.frame, strict=True)]
    kind = np.where(seen.object_index % 3 == 0, Kind.BOX, Kind.FOOT)
    observations = Observations(
        drive.rig,
        Sightings(seen.camera, seen.pixel_px),
        kind,
        np.full(kind.size, -1),
        np.array(stamps),
        trajectory,
    )
    names, label = np.unique(drive.objects.skiltnummer[seen.object_index], return_inverse=True)
    assert names.size > 5
    poses = trajectory.poses_at(observations.epoch_ns)
    return bearings_from_sightings(observations, poses, label.astype(np.int64) + 1, RULES)[0]


def one_after_the_other(seen: Bearings, rules: AssociationRules) -> IntArray:
    """Track picture by picture, every sighting against everything that was seen lately."""
    group = np.full(seen.row.size, -1)
    points, label, last_s = first_points(seen), seen.label.copy(), np.full(seen.row.size, -np.inf)
    for start, stop in pairwise(np.flatnonzero(np.diff(seen.frame, prepend=-1, append=-1)).tolist()):
        rows = np.arange(start, stop)
        active = np.flatnonzero(last_s >= seen.time_s[start] - rules.memory_s)
        i, j = np.repeat(rows, active.size), np.tile(active, rows.size)
        found = innovations(seen, i, points, j)
        joined = may_join(seen.face[i], seen.label[i], seen.face[j], label[j])
        cost = costs(found, points.covariance[j], joined, rules).reshape(rows.size, active.size)
        column = one_to_one(cost) if active.size else np.full(rows.size, -1)
        for k in np.flatnonzero(column >= 0):
            mine = active[column[k : k + 1]]
            update(points, mine, innovations(seen, rows[k : k + 1], points, mine))
            label[mine] = np.where(label[mine] == 0, seen.label[rows[k]], label[mine])
        group[rows] = np.where(column >= 0, active[column] if active.size else -1, rows)
        last_s[group[rows]] = seen.time_s[start]
    return numbered(group)


@pytest.mark.parametrize("unlabelled", [0.0, 0.02, 1.0])
@pytest.mark.parametrize("memory_s", [RULES.memory_s, 0.5])
def test_tracks_side_by_side_are_those_of_one_after_the_other(unlabelled: float, memory_s: float) -> None:
    """Whatever lacks a label, and however soon tracks are forgotten, the tracks are the same."""
    seen = bearings(0.5)
    none = np.random.default_rng(1).random(seen.row.size) < unlabelled
    seen, rules = replace(seen, label=np.where(none, 0, seen.label)), replace(RULES, memory_s=memory_s)
    found = track(seen, rules)
    assert found.max() > 5
    assert np.array_equal(found, one_after_the_other(seen, rules))
