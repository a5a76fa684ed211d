"""Axes that move together."""
