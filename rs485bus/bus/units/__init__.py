"""What is known of each address."""
