"""Intrinsics from pictures of a board."""
