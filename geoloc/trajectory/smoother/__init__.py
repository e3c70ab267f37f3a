"""The smoother behind a trajectory from GNSS: plane, tilt, and what receivers say of their motion."""
