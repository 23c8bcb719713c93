"""The files of a bag: MCAP and SQLite, whole, split, compressed or damaged."""
