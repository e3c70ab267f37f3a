"""Of which store findings are asked for, and by which settings."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from twin.errors import StoreError
from twin.matching.config import MatchConfig
from twin.matching.kept import Kept, digest
from twin.matching.left import LAYOUT
from twin.matching.likelihood import cost_of_common
from twin.matching.sites import Site, codes_of_mirror, sites_from_mirror
from twin.mirror.names import KATALOG_FACT
from twin.mirror.vegnett.network import FACT as VEGNETT
from twin.store.kinds import Method
from twin.store.store import Row, Snapshot, Store

Say = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Asked:
    """Of which store by which settings findings are asked for."""

    store: Store
    view: Snapshot
    method: str
    config: MatchConfig
    say: Say

    @property
    def has_network(self) -> bool:
        """Whether the store has the road network."""
        return self.view.fact(VEGNETT) is not None

    def rests_on(self) -> str:
        """Digest of everything that findings rest on but drives, NVDB's signs, and the roads beside them."""
        network = [self.view.fact(KATALOG_FACT)] if self.has_network else []
        said = json.dumps([LAYOUT, self.method, asdict(self.config), network], sort_keys=True)
        return digest(said.encode())

    def codes(self) -> dict[str, float]:
        """What it costs each code of the mirror to be common."""
        return cost_of_common(codes_of_mirror(self.view), self.config)


def choose_method(store: Store, method: str | None) -> str:
    """Return `method` if drives were ingested by it; by default the best one that some were."""
    present = store.methods()
    if not present:
        raise StoreError(f"The store {store.name} has no drive yet: run `twin ingest-drive` first.")
    if method is None:
        return next((name for name in Method if name in present), present[0])
    if method not in present:
        raise StoreError(
            f"No drive in the store {store.name} was ingested by --method {method}, only by "
            f"{', '.join(present)}: run `twin ingest-drive --method {method}` first."
        )
    return method


def sites_of(
    asked: Asked, rows: tuple[Sequence[Row], Sequence[Row]], kept: Kept, *, anew: bool = False
) -> list[Site]:
    """Sites of the mirror; with the road network also which way they face, and their road.

    What the last match found of roads holds unless it is to be worked out anew.
    """
    points, plates = rows
    if not asked.has_network:
        return sites_from_mirror(points, plates, asked.config)
    from twin.matching.roads import Roads

    roads = Roads(asked.store, asked.view, kept, anew=anew)
    return roads.along(sites_from_mirror(points, plates, asked.config, roads.faces(plates)))
