"""A target and the sound speed from arrivals."""
