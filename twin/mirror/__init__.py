"""The mirror of NVDB in the store: signs, their history, and the road network."""
