"""Which pictures of a board are still missing."""
