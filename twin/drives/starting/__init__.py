"""The first ``drive.toml`` of a folder from a dashcam, an action camera or a telephone."""
