"""One module a GNSS or pose format: the bytes of one file → arrays, and a count of what was left out."""
