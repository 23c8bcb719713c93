"""Truth and sensors: from a scenario to measurements, reproducibly from its seed."""
