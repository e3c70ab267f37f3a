"""Boards and tags in pictures: found, to a hundredth of a pixel."""
