"""A pair of hydrophones as a recorded run shows it: delay offset, spacing, yaw and polarity."""
