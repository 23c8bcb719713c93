"""Mathematics: numpy and scipy only. No ROS, no files, no clock, no printing."""
