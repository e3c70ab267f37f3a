"""Keep the road-sign layer of Norway's digital twin true: a recorded drive and NVDB in, change sets out."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("nvdb-twin")
except PackageNotFoundError:  # a source tree that was never installed
    __version__ = "0+unknown"
