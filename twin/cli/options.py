"""Options and choices that several commands take."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

StoreOption = Annotated[
    Path, typer.Option("--store", envvar="TWIN_STORE", help="The store, one SQLite file.", show_default=True)
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on stdout instead of tables.")
]


ByOption = Annotated[
    str | None,
    typer.Option(envvar="TWIN_USER", help="Who decides.  [default: the login name]", show_default=False),
]


class Method(StrEnum):
    """Geolocation methods, as in :data:`twin.store.schema.METHODS`."""

    ADJUSTED = "adjusted"
    SINGLE_FRAME = "single-frame"
    PAPER = "paper"


class ScenarioName(StrEnum):
    """Worlds to simulate, as in :data:`geoloc.simulation.simulate.SCENARIOS`."""

    SAMPLE = "sample"
    STILL = "still"
    APPROACH = "approach"
    URBAN = "urban"
    HIGHWAY = "highway"


class PairBy(StrEnum):
    """How estimates find their truth, as in :data:`twin.reports.evaluate.BY`."""

    AUTO = "auto"
    ID = "id"
    POSITION = "position"


class FindingVerdict(StrEnum):
    """Verdicts that ask for a decision."""

    NEW = "new"
    MISSING = "missing"
    MOVED = "moved"
    WRONG_TYPE = "wrong_type"
    REVIEW = "review"


class DecisionName(StrEnum):
    """Decisions, as in :data:`twin.decisions.log.DECISIONS`."""

    OPEN = "open"
    ACCEPT = "accept"
    DISMISS = "dismiss"
    DEFER = "defer"


class SetDecision(StrEnum):
    """Decisions whose findings an export turns into change sets."""

    ACCEPT = "accept"
    OPEN = "open"


class Realm(StrEnum):
    """Kinds of users of API Skriv, as in :data:`nvdb.skriv.login.Realm`."""

    EMPLOYEE = "EMPLOYEE"
    SERVICE_ACCOUNT = "SERVICE_ACCOUNT"
    EXTERNAL = "EXTERNAL"


class SourceName(StrEnum):
    """APIs that a mirror can follow, as in :data:`twin.mirror.sync.SOURCES`."""

    LES_V4 = "les-v4"
    UBERIKET = "uberiket"


DEFAULT_STORE = Path("twin.db")
DEFAULT_API = "https://nvdbapiles.atlas.vegvesen.no"
DEFAULT_SKRIV_API = "https://nvdbapiskriv.test.atlas.vegvesen.no"
"""The test environment: what changes NVDB itself is named on purpose."""
