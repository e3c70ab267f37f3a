"""Boards, tags and the plan of a yard as PDF at true scale."""
