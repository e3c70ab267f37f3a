"""The changes as one picture."""
