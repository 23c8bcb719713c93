"""Bearings of pingers from the samples of two hydrophones."""
