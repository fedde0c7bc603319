"""URDF: reading, writing, and what it does not know."""
