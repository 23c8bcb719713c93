"""Where sources are, from bearings and known motion."""
