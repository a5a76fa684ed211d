"""The bench: finding drives, setting them up, measuring and proving them, before a program is written."""
