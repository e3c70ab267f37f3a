"""docs/reference/: pages that the code itself writes. ``python tools/make_reference.py`` makes them anew."""
