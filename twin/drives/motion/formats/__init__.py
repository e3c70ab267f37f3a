"""One module a format: a recording → samples as they stand in it."""
