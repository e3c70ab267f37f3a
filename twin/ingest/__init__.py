"""A recorded drive → estimates in the store."""
