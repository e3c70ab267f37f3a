"""The Norwegian road database: client, objects, mirror, road network, change sets and a replay server.

Knows the road database and nothing of cameras. The rooms, each with a face of its own:

- :mod:`nvdb.client`: HTTP to the APIs, with retries, deadlines and the one paging loop
- :mod:`nvdb.datakatalog`: the catalogue: ids of properties and enum values, sign codes
- :mod:`nvdb.objects`: vegobjekter as frozen records, from API Les V4 and Uberiket
- :mod:`nvdb.area`: which part of the country is asked for
- :mod:`nvdb.mirror`: a mirror that follows NVDB's changes
- :mod:`nvdb.vegnett`: the road network, and where along it a point lies (stedfesting)
- :mod:`nvdb.endringssett`: change sets: built, checked, written, undone
- :mod:`nvdb.skriv`: API Skriv: log in, send change sets, follow them
- :mod:`nvdb.replay`: a server on loopback that answers as NVDB does
- :mod:`nvdb.errors`: the tree of errors

The names handed on here stand in ``__init__.pyi`` and are loaded when they are first used, so that
``import nvdb`` costs nothing. Only :mod:`nvdb.client` opens a socket to an API.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
