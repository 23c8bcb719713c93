"""Bearings: the Cramer-Rao bound, multipath, and what is inside a frame."""
