"""The program `uwloc`."""
