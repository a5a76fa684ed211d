"""The drives, as axes."""
