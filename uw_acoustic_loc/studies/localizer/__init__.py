"""One source from bearings."""
