"""One file per estimator node: which topics go in and out, which core object works between. No rclpy, no files."""
