"""Bringing devices to a stand."""
