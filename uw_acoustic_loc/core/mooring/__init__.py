"""A moored buoy's offset through impulsive noise."""
