"""What a fleet's process does with a part of a match: it reads the store, its worker writes."""

from __future__ import annotations

# Loaded once for all processes of a worker, which are forks of one that has this module.
import scipy.sparse.csgraph
import scipy.spatial  # noqa: F401

from twin.fleet.locating import Failed, failure
from twin.matching.tiles import Worked, work_out
from twin.store.address import StoreAddress


def part_at(address: StoreAddress, method: str, plan: str, name: str) -> Worked | Failed:
    """Work out a part of a match: the work that any process can do that reaches the store.

    Parameters
    ----------
    address : StoreAddress
    method : str
    plan, name : str
        As :func:`twin.matching.tiles.parts_to_do` gives them.
    """
    try:
        return work_out(address, method, plan, name)
    except Exception as error:  # it goes to another process, which may not have the exception's class
        return failure(error)
