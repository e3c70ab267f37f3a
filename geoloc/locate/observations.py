"""All that the cameras of a drive saw, in one piece: what adjustment and association go by."""

from __future__ import annotations

from dataclasses import dataclass, replace

from geoloc.arrays import BoolArray, IntArray, TextArray
from geoloc.locate.records import Sightings
from geoloc.rig.rig import Rig
from geoloc.trajectory.trajectory import Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """The sightings of a drive with what is known of each, and the track they were made from.

    Attributes
    ----------
    rig : Rig
    sightings : Sightings (n,)
    kind : str (n,)
        A `geoloc.locate.records.Kind`: what the pixel shows.
    object_index : int64 (n,)
        Which object a sighting belongs to; negative: none, or not known.
    epoch_ns : int64 (n,)
        UTC of the exposure of the frame's middle row, the same for all sightings of one picture.
    trajectory : Trajectory
    """

    rig: Rig
    sightings: Sightings
    kind: TextArray
    object_index: IntArray
    epoch_ns: IntArray
    trajectory: Trajectory

    def take(self, rows: IntArray | BoolArray) -> Observations:
        """Those sightings alone."""
        return replace(
            self,
            sightings=Sightings(self.sightings.camera[rows], self.sightings.pixel_px[rows]),
            kind=self.kind[rows],
            object_index=self.object_index[rows],
            epoch_ns=self.epoch_ns[rows],
        )
