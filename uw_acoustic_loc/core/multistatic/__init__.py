"""Targets of a multistatic sonar net."""
