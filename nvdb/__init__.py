"""The Norwegian road database: client, objects, mirror and a replay server.

Knows the road database and nothing of cameras. Only :mod:`nvdb.client` opens a socket to an API;
:mod:`nvdb.replay` serves recorded pages on loopback.
"""
