"""A target in 3-D and the sound speed, from times of arrival."""
