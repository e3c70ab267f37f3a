"""A whole country of generated signs behind NVDB's addresses: for benchmarks, tests, and to try things out.

python benchmarks/nvdb_country 573299,1153655 --port 8096
"""

from nvdb_country.world import GeneratedWorld

__all__ = ["GeneratedWorld"]
