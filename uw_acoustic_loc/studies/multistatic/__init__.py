"""Fixes of a multistatic net."""
