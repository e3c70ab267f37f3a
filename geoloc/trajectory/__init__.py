"""GNSS fixes or poses → the pose of the rig, with its covariance, at any epoch."""
