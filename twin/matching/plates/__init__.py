"""Plates of a pole: what was read, in which words, with which text."""
