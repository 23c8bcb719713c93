"""EKF-SLAM with three pingers."""
