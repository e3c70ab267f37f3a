"""The methods of a store that give researchers its tables."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import geopandas as gpd

    from twin.store.store import Snapshot


class _Snapshots(Protocol):
    def snapshot(self) -> AbstractContextManager[Snapshot]: ...


class Tables:
    """Tables of a store as GeoDataFrames, only read; :data:`twin.store.frames.COLUMNS` has the units."""

    def estimates(self: _Snapshots, method: str | None = None) -> gpd.GeoDataFrame:
        """Return where the annotated objects stand: a point an object, drive and method, EPSG:25833.

        Parameters
        ----------
        method : {"adjusted", "single-frame", "paper"}, optional
            Default: every method by which drives were ingested, a row each.

        Returns
        -------
        GeoDataFrame of Point
            Columns and units: ``twin.store.frames.COLUMNS["estimates"]``, also in ``twin help python``.

        Raises
        ------
        ConfigError
            No such method.
        """
        from twin.store import frames

        with self.snapshot() as view:
            return frames.estimates(view, method)

    def findings(self: _Snapshots) -> gpd.GeoDataFrame:
        """Return what the last match says of each sign, and what people decided: a point a finding.

        Returns
        -------
        GeoDataFrame of Point
            EPSG:25833: where the sign stands now, NVDB's position for what was not seen. Columns and units:
            ``twin.store.frames.COLUMNS["findings"]``. Sigmas are of the measured position, else NaN.

        Raises
        ------
        StoreError
            Nothing was matched yet.
        RefusedError
            Drives or mirror have changed since.
        """
        from twin.store import frames

        with self.snapshot() as view:
            return frames.findings(view)

    def sightings(self: _Snapshots, method: str | None = None) -> gpd.GeoDataFrame:
        """Return every annotated pixel or box, with the position that it gives by itself, EPSG:25833.

        Parameters
        ----------
        method : {"adjusted", "single-frame", "paper"}, optional
            Default: every method by which drives were ingested, a row each.

        Returns
        -------
        GeoDataFrame of Point
            No geometry where the picture alone gives no position, and the sigmas NaN. Columns and units:
            ``twin.store.frames.COLUMNS["sightings"]``.

        Raises
        ------
        ConfigError
            No such method.
        """
        from twin.store import frames

        with self.snapshot() as view:
            return frames.sightings(view, method)

    def drives(self: _Snapshots) -> gpd.GeoDataFrame:
        """Return the recorded drives, the oldest first: a line each, EPSG:25833.

        Returns
        -------
        GeoDataFrame of LineString
            Columns and units: ``twin.store.frames.COLUMNS["drives"]``.
        """
        from twin.store import frames

        with self.snapshot() as view:
            return frames.drives(view)
