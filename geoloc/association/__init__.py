"""Parts of :mod:`geoloc.associate`: bearings, points seen along them, tracking, merging and joining."""
