"""Pixels and poses in, positions with covariance out.

Pure geometry: arrays and frozen dataclasses in and out. No database, no network, no files but calibration
files. CONVENTIONS.md says what frames, units and signs mean.

Where the car was

- `GnssFixes` of each antenna → `trajectory_from_gnss` → `Trajectory`
- `PoseTrack` of an INS or SLAM → `trajectory_from_poses` → `Trajectory`
- `VehicleMotion`: the car's own speed and turning, each a `MotionSeries` → `MotionFound` of a `Trajectory`
- `Trajectory.poses_at(epochs)` → `Poses`

What its cameras saw

- `read_rig` → `Rig` of `RigCamera`: intrinsics, mounting, masks, lever arms
- `Sightings`: pixels by camera; `Kind`: what a pixel shows

Where it stands

- `locate_single_frame`: each sighting from its own frame, on the plane of the road → `Located`
- `locate_on_terrain`: the same on a measured ground, a `Terrain`
- `locate_paper`: the baseline, arXiv:2401.07582
- `adjust`: all sightings of a drive, `Observations`, in one least squares → `Adjusted`
- `ErrorBudget`: one sigma of every source of error; `Reason`: why something has no position

`GeolocError` is the base of every error that these raise. The rooms behind them: :mod:`geoloc.earth`,
:mod:`geoloc.cameras`, :mod:`geoloc.rig`, :mod:`geoloc.trajectory`, :mod:`geoloc.locate`,
:mod:`geoloc.adjustment`, :mod:`geoloc.association` (which sightings are one object),
:mod:`geoloc.calibration`, :mod:`geoloc.calibration_files` and :mod:`geoloc.simulation`. The names are loaded
when they are first used; which module has which stands in ``__init__.pyi``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
