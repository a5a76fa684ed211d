"""A live view of a plant, in a terminal. It needs the extra `monitor` (textual)."""
