"""Cycles: moves one after the other, what happens between them, the cell as it changes."""
