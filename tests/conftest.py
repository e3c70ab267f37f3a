"""Settings that every test shares."""

from __future__ import annotations

import gc
import os
import sys

import pytest
import sqlalchemy as sa
from hypothesis import settings
from sqlalchemy.dialects.sqlite.pysqlite import SQLiteDialect_pysqlite
from sqlalchemy.util import LRUCache

# Before NumPy is loaded: matrices are small here, and the threads of several workers on the same cores wait
# for one another, up to eight times as long.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# What the person who runs the tests has set in a twin.toml of their own is none of the tests' business.
os.environ["XDG_CONFIG_HOME"] = "/nonexistent"

# A process that a test starts has the bytecode of those before it, also where the environment keeps none:
# compiling our modules is a third of what a short command costs.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A clock never decides a test, and every run draws the same examples; `make soak` draws more of them.
EXAMPLES = int(os.environ.get("TWIN_EXAMPLES", "25"))
settings.register_profile("twin", deadline=None, derandomize=True, database=None, max_examples=EXAMPLES)
settings.load_profile("twin")

# A statement is compiled for a dialect, and every store that is opened has one of its own. Those of SQLite
# are all alike here: what is compiled for one serves the others, a tenth of what a short command costs.
_COMPILED: LRUCache[object, object] = LRUCache(2000)
SQLiteDialect_pysqlite.__hash__ = lambda self: hash(type(self))  # type: ignore[method-assign]
SQLiteDialect_pysqlite.__eq__ = lambda self, other: type(self) is type(other)  # type: ignore[method-assign]


@sa.event.listens_for(sa.Engine, "engine_connect")
def _share_compiled_statements(connection: sa.Connection) -> None:
    if connection.dialect.name == "sqlite":
        connection.execution_options(compiled_cache=_COMPILED)


# What takes longest comes first: a long file that begins last would leave the other cores idle (`make test`
# gives each core whole files, for what their tests share).
_LONGEST = (
    "twin/review/test_page.py",
    "twin/calibrate/test_calibrate_intrinsics.py",
    "geoloc/calibration/test_intrinsics.py",
    "twin/calibrate/test_extrinsics_command.py",
    "twin/cli/test_machine.py",
    "twin/calibrate/test_mounting_recipe.py",
    "twin/export/test_folder.py",
    "twin/mirror/test_faults.py",
    "twin/drives/test_fault_matrix.py",
    "twin/matching/test_match.py",
    "geoloc/adjustment/test_adjust.py",
    "twin/export/test_findings.py",
    "twin/ingest/test_ingest.py",
    "geoloc/adjustment/test_clock.py",
    "twin/evidence/test_make.py",
    "twin/calibrate/test_prints.py",
    "twin/changesets/test_sent_once.py",
    "geoloc/trajectory/test_smoother.py",
    "geoloc/calibration/test_extrinsics_contradiction.py",
    "geoloc/association/test_associate.py",
    "twin/mirror/test_kill.py",
    "twin/matching/test_renumbered.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the long files first, each whole; the others keep their order. Slow tests are for `make slow`."""
    if "TWIN_SLOW" not in os.environ:
        for item in items:
            if item.get_closest_marker("slow"):
                item.add_marker(pytest.mark.skip(reason="TWIN_SLOW=1: make slow"))
    if os.environ.get("TWIN_TEST_STORES") == "postgresql":
        for item in items:
            if item.get_closest_marker("file"):
                item.add_marker(pytest.mark.skip(reason="of a store in a file"))
    place = {f"tests/{name}": at for at, name in enumerate(_LONGEST)}
    items.sort(key=lambda item: place.get(item.nodeid.partition("::")[0], len(place)))


def pytest_collection_finish() -> None:
    """Take modules and thousands of collected tests out of what the garbage collector goes through anew."""
    gc.collect()
    gc.freeze()
