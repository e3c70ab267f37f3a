"""One module an annotation format: the bytes of one file → shapes, and a count of what was left out."""
