"""A mooring in impulsive noise."""
