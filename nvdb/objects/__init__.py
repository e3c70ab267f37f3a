"""Objects of NVDB as frozen records: Vegobjekt, Skiltpunkt, Skiltplate, geometry, read from its answers."""
