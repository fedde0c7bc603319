"""The library of effects: one file each, found by itself."""
