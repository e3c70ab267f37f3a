"""The check of a drive that goes on: estimates and NVDB's signs about it → verdicts as soon as they hold.

The rules are those of a match (:mod:`twin.matching`): the same likelihood, with the covariance that the
engine states now, the same one-to-one assignment, the same verdicts. What differs is when they are asked:
about each pole as its estimate changes, about each sign of NVDB when it has gone out of view.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from geoloc.arrays import BoolArray, FloatArray
from geoloc.earth.geodesy import grid_convergence_deg, utm33_from_geographic
from geoloc.trajectory.interpolation import NANOSECONDS
from twin.live.check.ahead import SignsAhead
from twin.live.check.poles import DRIVE, Pole, Poles
from twin.live.check.standing import Scene, Subject, judged
from twin.live.check.verdict import Standing, Verdict
from twin.live.check.watched import InView, SiteId, Watched, id_of
from twin.live.engine import LiveEngine
from twin.live.estimates import Estimate
from twin.live.events import Arrival, Frame
from twin.matching.absence import Passage, evidence_of_absence
from twin.matching.config import MatchConfig
from twin.matching.in_view import Counts
from twin.matching.sites import Site

_LOOK_EVERY_S = 0.5
_EXPECTED_M = 100.0
"""Signs of NVDB are said to be expected from so far ahead."""
_BESIDE_M = 15.0
"""Poles and signs that may compete stand so much beyond what has changed, and theirs as much beyond these."""
_FORGET_M = 1000.0


class LiveCheck:
    """What the engine locates, held against the signs that NVDB has along the way.

    Parameters
    ----------
    engine : LiveEngine
        Fed with each arrival before the check is.
    signs : SignsAhead
    is_complete : bool
        Whether frames come with every sign that they show, so that a sign that is not among them is gone.
    config : MatchConfig, optional
    """

    def __init__(
        self, engine: LiveEngine, signs: SignsAhead, *, is_complete: bool, config: MatchConfig | None = None
    ) -> None:
        self._engine, self._signs, self._is_complete = engine, signs, is_complete
        self._config = config or MatchConfig()
        self._watched = Watched(engine.car, signs, self._config)
        self._poles = Poles(self._config)
        self._said: dict[str, tuple[Subject, Verdict]] = {}
        self._looked_for: dict[SiteId, int] = {}
        self._met: set[SiteId] = set()
        self._now_ns = self._began_ns = self._looked_ns = 0
        self._unfollowed = 0
        self._is_known, self._ended = True, False

    def take(self, arrival: Arrival, estimates: Sequence[Estimate]) -> list[Verdict]:
        """Take what has arrived and the estimates that came of it; return verdicts, new or changed."""
        at_ns, what = arrival
        self._began_ns = self._began_ns or at_ns
        if isinstance(what, Frame):
            # A frame in which something was seen that nobody could follow tells nothing of what is not there.
            if self._engine.unfollowed == self._unfollowed:
                self._watched.take(what)
            self._unfollowed = self._engine.unfollowed
            self._poles.see(what, self._engine.shown)
        return self.let_pass(at_ns, estimates)

    def let_pass(self, now_ns: int, estimates: Sequence[Estimate]) -> list[Verdict]:
        """Take that it is so late, and the estimates that came of it; return verdicts, new or changed."""
        self._now_ns = max(self._now_ns, now_ns)
        touched = self._poles.take(estimates)
        if self._now_ns - self._looked_ns < _LOOK_EVERY_S * NANOSECONDS:
            return self._judge(touched)
        self._looked_ns = self._now_ns
        found = self._look()
        return found + self._judge(np.concatenate([touched, self._gone_by()]))

    def finish(self, estimates: Sequence[Estimate]) -> list[Verdict]:
        """End the drive with the last estimates: nothing is in view any longer."""
        self._ended = True
        touched, found = self._poles.take(estimates), self._look()
        found += self._judge(np.concatenate([touched, self._gone_by()]))
        self._signs.close()
        return found

    def _look(self) -> list[Verdict]:
        """Follow the car: what it has in view, and what comes next."""
        trajectory = self._engine.trajectory
        pose = None if trajectory is None else self._engine.pose(min(self._now_ns, trajectory.span_ns[1]))
        if pose is None or not pose.valid[0]:
            self._watched.look(None)
            return []
        place_m = np.array(utm33_from_geographic(pose.latitude_deg, pose.longitude_deg))[:, 0]
        grid_rad = np.deg2rad(pose.heading_deg - grid_convergence_deg(pose.latitude_deg, pose.longitude_deg))[
            0
        ]
        self._is_known = self._signs.move(place_m)
        self._poles.drive(int(pose.epoch_ns[0]), place_m)
        self._watched.look(trajectory)
        self._forget(place_m)
        if not self._is_known:
            return []
        return self._expected(place_m, np.array([np.sin(grid_rad), np.cos(grid_rad)]))

    def _expected(self, place_m: FloatArray, ahead: FloatArray) -> list[Verdict]:
        found = []
        for site in self._signs.near(place_m[None], _EXPECTED_M):
            subject = Subject.of_site(site)
            is_ahead = (np.array([site.east_m, site.north_m]) - place_m) @ ahead > 0.0
            if site.own_geometry and is_ahead and subject.id not in self._said:
                found.append(self._say(subject, subject.expected(self._now_ns)))
        return found

    def _gone_by(self) -> FloatArray:
        """Where signs of NVDB stand that went out of view since they were last judged (n, 3)."""
        places = []
        for seen in self._watched.known():
            if self._has_passed(seen) and self._looked_for.get(id_of(seen.site)) != seen.last_ns:
                self._looked_for[id_of(seen.site)] = seen.last_ns
                places.append((seen.site.east_m, seen.site.north_m, 0.0))
        return np.array(places, dtype=np.float64).reshape(-1, 3)

    def _has_passed(self, seen: InView) -> bool:
        """Whether a sign is out of view, and nothing that was seen meanwhile waits for a place of its own."""
        if self._ended:
            return seen.views > 0
        waits = self._engine.without_place
        beside = any(begin <= seen.last_ns and end >= seen.first_ns for begin, end in waits)
        return self._watched.has_passed(seen) and not beside

    def _judge(self, touched: FloatArray) -> list[Verdict]:
        """Judge what stands about places where something has changed: east, north and reach (n, 3)."""
        if not len(touched) or not self._is_known:
            return []
        places_m = touched[:, :2]
        reach_m = max(self._config.gate_m, float(touched[:, 2].max()))
        beyond_m = 2.0 * (reach_m + _BESIDE_M)
        poles = self._poles.near(places_m, beyond_m)
        sites = self._signs.near(places_m, beyond_m)
        scene = self._scene(poles, sites)
        found, inside = judged(scene, places_m, reach_m + _BESIDE_M)
        self._met.update(found.paired)
        said = list[Verdict]()
        for subject, verdict in found.verdicts:
            if subject.owner in inside:
                said += self._changed(subject, verdict._replace(at_ns=self._now_ns))
        holds = {subject.id for subject, _ in found.verdicts}
        for name, (subject, before) in list(self._said.items()):
            is_open = subject.owner in inside and name not in holds
            if is_open and not found.keeps(subject, before.standing):
                why = found.doubts.get(subject.owner)
                said += self._changed(subject, subject.taken_back(before, why, self._now_ns))
        return said

    def _scene(self, poles: Sequence[Pole], sites: Sequence[Site]) -> Scene:
        seen = [self._watched.of(site) for site in sites]
        lost = [self._poles.was_lost(one.first_ns, one.last_ns) for one in seen]
        told = [(0, 0) if no else (one.views, one.fronts) for one, no in zip(seen, lost, strict=True)]
        views, fronts = np.array(told, dtype=np.int64).reshape(-1, 2).T
        passage = Passage(DRIVE, self._began_ns, self._is_complete, Counts(views, fronts))
        passed: BoolArray = np.array([self._has_passed(one) for one in seen], dtype=np.bool_)
        # A sign that the drive met earlier stands, though its pole is forgotten.
        known = np.array([id_of(site) in self._met for site in sites], dtype=np.bool_)
        places_m = np.array([(one.seen.east_m, one.seen.north_m) for one in poles]).reshape(-1, 2)
        return Scene(
            poles=poles,
            sites=sites,
            absence=evidence_of_absence([passage], sites, self._config),
            passed=passed,
            may_miss=passed & ~known,
            mirrored=self._signs.is_mirrored(places_m),
            common=self._signs.common,
            config=self._config,
        )

    def _changed(self, subject: Subject, verdict: Verdict) -> Iterable[Verdict]:
        """Say a verdict if it differs from what was said before."""
        _, before = self._said.get(subject.id, (None, None))
        if before is not None and _essence(before) == _essence(verdict):
            return []
        if before is None and verdict.standing in (Standing.EXPECTED, Standing.WITHDRAWN):
            return []
        return [self._say(subject, verdict)]

    def _say(self, subject: Subject, verdict: Verdict) -> Verdict:
        _, before = self._said.get(subject.id, (None, None))
        said = verdict._replace(was=None if before is None else before.standing)
        self._said[subject.id] = subject, said
        return said

    def _forget(self, place_m: FloatArray) -> None:
        """Forget what lies behind: verdicts are said, signs are read again where the car comes back."""
        self._poles.forget(place_m, _FORGET_M)
        for name, (_, said) in list(self._said.items()):
            if np.hypot(said.east_m - place_m[0], said.north_m - place_m[1]) > _FORGET_M:
                del self._said[name]
        for seen in self._watched.known():
            site = seen.site
            if np.hypot(site.east_m - place_m[0], site.north_m - place_m[1]) > _FORGET_M:
                self._watched.forget([id_of(site)])
                self._looked_for.pop(id_of(site), None)


def _essence(said: Verdict) -> Mapping[str, object]:
    """What is worth a line of its own where it changes."""
    codes = said.skiltnummer_seen if said.standing is not Standing.EXPECTED else ()
    return {"standing": said.standing, "final": said.is_final, "pole": said.pole, "codes": codes}
