"""A mirror that follows NVDB: everything once, then only the changes, over a `MirrorStore`."""
