"""Runs a graph: a process per node, readiness, the clock, and an ordered stop."""
