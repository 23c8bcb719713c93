"""What a recorded run says of a pair of hydrophones: delay offset, spacing, yaw and polarity, as docs/calibration.md."""
