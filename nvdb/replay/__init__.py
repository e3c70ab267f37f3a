"""A server on loopback that answers as NVDB does, from recorded or generated pages: demo, tests, faults."""
