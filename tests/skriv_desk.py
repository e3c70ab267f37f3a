"""A local API Skriv with a user, and a small change set for it."""

from __future__ import annotations

from contextlib import ExitStack
from datetime import UTC, date, datetime, timedelta
from typing import Any

from nvdb.client import NvdbClient
from nvdb.endringssett import (
    Egenskap,
    Endring,
    Endringssett,
    Measured,
    NewPlate,
    Punkt,
    Stedfesting,
    Target,
    endringssett,
    position_correction,
)
from nvdb.replay.skriv import ReplayObject, SkrivReplayServer, SkrivWorld
from nvdb.skriv import OidcLogin, SkrivClient

START = datetime(2026, 11, 1, 12, 0, tzinfo=UTC)
READ = datetime(2026, 10, 31, tzinfo=UTC)
DAY = date(2026, 10, 31)
OLD_PLACE = Punkt(veglenkesekvens_id=2510771, posisjon=0.1, retning="MED")
PLACE = Punkt(veglenkesekvens_id=2510771, posisjon=0.25, retning="MED")
MEASURED = Measured(east_m=270000, north_m=7040000, std_m=0.1, captured=DAY)
SIGN = [NewPlate(skiltnummer="362.50", plasseringskode=10)]
PASSWORD = "hemmelig-7b1f"  # of the local server


class Desk:
    """A local API Skriv, a user of it, and a clock that only runs when somebody waits."""

    def __init__(self, stack: ExitStack, **options: Any) -> None:
        self.now = START
        self.waits: list[float] = []
        point = ReplayObject(
            type_id=95, nvdb_id=50, versjon=2, barn=[51], stedfesting=Stedfesting(punkter=(OLD_PLACE,))
        )
        code = {5530: Egenskap(type_id=5530, enum=(8874,))}
        plate = ReplayObject(type_id=96, nvdb_id=51, egenskaper=code, stedfesting=point.stedfesting)
        rights = options.pop("rights", frozenset({95, 96}))
        self.world = SkrivWorld([point, plate], rights=rights, now=self.time)
        self.server = stack.enter_context(
            SkrivReplayServer(self.world, users={"olanor": PASSWORD}, **options)
        )
        http = NvdbClient(self.server.url, timeout_s=5.0, sleep=self.wait)
        self.http = stack.enter_context(http)
        self.logins = 0
        self.login = OidcLogin(self.http, self._credentials, clock=self.seconds)
        self.client = SkrivClient(self.http, self.login, sleep=self.wait, clock=self.seconds)

    def _credentials(self) -> tuple[str, str]:
        self.logins += 1
        return "olanor", PASSWORD

    def time(self) -> datetime:
        """Present time."""
        return self.now

    def seconds(self) -> float:
        """Present time, seconds since 1970."""
        return self.now.timestamp()

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.waits.append(seconds)
        self.now += timedelta(seconds=seconds)

    def asked(self, end: str) -> int:
        """How often a path with this end was asked for."""
        return sum(path.endswith(end) for _, path in self.server.requests)


def set_of(*groups: tuple[Endring, ...]) -> Endringssett:
    """One change set of these groups."""
    (sett,) = endringssett(groups, datakatalogversjon="2.38")
    return sett


def correction() -> Endringssett:
    """The position of sign 50 measured anew, its plate with it."""
    targets = Target(95, 50, 2, READ), Target(96, 51, 1, READ)
    return set_of(position_correction(targets[0], MEASURED, plates=targets[1:], stedfesting=PLACE))
