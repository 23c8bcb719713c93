"""ROS message fields <-> core types, by attribute only: works on rclpy's and rosbags' message classes alike."""
