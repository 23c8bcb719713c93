"""What nets can do, before they are laid out."""
