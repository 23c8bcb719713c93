"""MCAP bags in and out, and the offline run of stages on them: no DDS, no rclpy."""
