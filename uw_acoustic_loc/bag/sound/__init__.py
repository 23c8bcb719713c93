"""Sound files of recorders: what they hold, when they began, and how they become a bag."""
