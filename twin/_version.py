"""The version that is installed; apart, since to ask for it takes longer than to load all commands."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("nvdb-twin")
except PackageNotFoundError:  # a source tree that was never installed
    __version__ = "0+unknown"
