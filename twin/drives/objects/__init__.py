"""Which annotations show one and the same object."""
