"""Estimates and the mirror → findings: gate, assign one-to-one, judge.

Poles are matched to Skiltpunkt by position, plates to Skiltplate on the matched pole by sign code. "No match"
is a hypothesis of its own that competes with every pair.
"""
