"""Acoustic localization for AUVs: bearings, positions and tracks from sound, as ROS 2 nodes and on recorded bags."""

__version__ = "0.1.0"
