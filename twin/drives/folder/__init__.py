"""A drive's folder: which files it holds, and what its drive.toml says."""
