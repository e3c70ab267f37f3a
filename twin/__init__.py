"""Keep the road-sign layer of Norway's digital twin true: a recorded drive and NVDB in, change sets out.

==================  ==================================================================================
Store               the twin's state, a SQLite file or a PostgreSQL database: every function below takes an
                    open one; its tables as GeoDataFrames (estimates, findings, sightings, drives)
sync_nvdb           NVDB's signs of an area into the store: everything once, then the changes
ingest_drive        a recorded drive, located, into the store
match               the drives' estimates against NVDB's signs: findings with verdict and reason
decide, undo        what people say of findings; what they said before
export_findings     layers for QGIS, and change sets of what was accepted
evaluate            the estimates of each method against surveyed positions (read_truth)
TwinError           base of every error that these raise, beside nvdb.NvdbError and geoloc.GeolocError
==================  ==================================================================================

The whole job::

    from nvdb import Area
    from twin import Store, export_findings, ingest_drive, match, sync_nvdb

    with Store.open("twin.db") as store:
        sync_nvdb(store, Area(kommuner=(5001,)), api_url="https://nvdbapiles.atlas.vegvesen.no")
        ingest_drive(store, "path/to/trip")
        print(match(store).verdicts)
        export_findings(store, "out")

Each function is also a command (:mod:`twin.cli`). The names are loaded when they are first used; which
module has which is written in ``__init__.pyi``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
