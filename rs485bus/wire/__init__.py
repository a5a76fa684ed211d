"""The wire: timing, frames, receiving, registers. Pure: no clock, no I/O, no async, no family."""
