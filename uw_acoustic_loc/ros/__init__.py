"""The only layer that imports rclpy: one adapter that turns any stage into a node, drivers, recorder, player."""
