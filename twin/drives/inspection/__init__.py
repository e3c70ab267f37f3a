"""``twin inspect``: what a drive folder holds, what of it is understood, and what is missing."""
