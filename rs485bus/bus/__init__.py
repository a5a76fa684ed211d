"""The bus: one owner holds the wire, everything else asks it."""
