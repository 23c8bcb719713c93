"""A vehicle and pingers, from inertial data and bearings."""
