"""What every input goes through before its stage: settings, checks, latched values, stamps watched."""
