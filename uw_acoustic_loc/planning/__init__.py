"""The accuracy that nets of buoys and receivers can reach, before they are laid out."""
