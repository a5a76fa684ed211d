"""What goes onto the wire next."""
