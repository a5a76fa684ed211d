"""What a client's process does: one task, on one port, then it prints what it found."""
