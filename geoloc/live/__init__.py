"""Positions while a drive goes on: a trajectory that follows its fixes, and landmarks in a sliding window."""
